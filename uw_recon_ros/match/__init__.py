"""Matching (paper section 2.3): disparity by graph cuts."""

from uw_recon_ros.lazy_import import make_callable

make_callable(__name__, "uw_recon_ros.api")
