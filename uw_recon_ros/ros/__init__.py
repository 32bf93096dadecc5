"""What several nodes share of ROS: messages, parameters, quality of service, the node base class."""
