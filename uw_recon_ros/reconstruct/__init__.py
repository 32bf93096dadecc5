"""Disparity to depth, clouds and a textured surface (paper sections 2.3 and 3)."""

from uw_recon_ros.lazy_import import make_callable

make_callable(__name__, "uw_recon_ros.api")
