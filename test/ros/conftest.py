"""Messages check their fields, so that a wrong type fails here and not in the middleware."""

import os

os.environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "1")
