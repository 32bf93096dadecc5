"""What calibrators call the same distortion: every file's and driver's word to ROS's name."""

from __future__ import annotations

_ALIASES = {
    "plumb_bob": ("plumb_bob", "radtan", "radial_tangential", "radialtangential", "brown", "brown_conrady", "opencv",
                  "pinhole", "perspective", "none", "standard"),
    "equidistant": ("equidistant", "equi", "fisheye", "opencv_fisheye", "kannala_brandt", "kannala_brandt4", "kb4"),
    "rational_polynomial": ("rational_polynomial", "rational", "full_opencv"),
}  # fmt: skip
_NAMES = {alias: name for name, aliases in _ALIASES.items() for alias in aliases}


def model_named(told: str, count: int = 0) -> str:
    """ROS's name of a distortion model; a name that is not known comes back as it is.

    Parameters
    ----------
    told : str
    count : int
        Coefficients beside it: eight and more of OpenCV's order are the rational polynomial's, whatever it is called.
    """
    name = _NAMES.get(told.strip().lower().replace("-", "_").replace(" ", "_"), told)
    return "rational_polynomial" if name == "plumb_bob" and count in (8, 12, 14) else name
