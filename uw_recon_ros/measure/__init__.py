"""Lengths, heights and areas in one rectified view with its disparity, each with its standard deviation."""

from uw_recon_ros.lazy_import import make_callable

make_callable(__name__, "uw_recon_ros.api")
