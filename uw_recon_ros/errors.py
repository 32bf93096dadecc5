"""What the data did wrong, with the numbers in the text.

A caller's mistake is a plain ``ValueError`` or ``TypeError``; these errors are for images, calibrations and bags.
They are caught in two places only: the node shell (frame dropped, counted, reported) and the command line.
"""

from __future__ import annotations

from typing import ClassVar

from uw_recon_ros.findings import Code


class ReconError(Exception):
    """Base of all errors that the data, not the caller, caused.

    Parameters
    ----------
    text : str
        What, got, expected, and what to do; one line.
    code : Code or None
        What happened, for programs; None: what the class says.
    """

    default_code: ClassVar[Code] = Code.DATA

    def __init__(self, text: str = "", code: Code | None = None) -> None:
        super().__init__(text)
        self.code = self.default_code if code is None else code


class MessageError(ReconError):
    """A message's header makes no sense: its stamp, or the name of its frame."""

    default_code = Code.MESSAGE


class ImageError(ReconError):
    """An image or image message cannot be read: size, step, encoding, truncated data."""

    default_code = Code.IMAGE


class CalibrationError(ReconError):
    """A calibration is missing, inconsistent, or does not describe a stereo rig."""

    default_code = Code.CALIBRATION


class EstimationError(ReconError):
    """A quantity cannot be estimated from these images: too few matches, forward motion, swapped cameras."""

    default_code = Code.ESTIMATION


class BagError(ReconError):
    """A bag cannot be read or written, or does not hold what was asked of it."""

    default_code = Code.BAG


class TrajectoryError(ReconError):
    """A trajectory cannot be read, or cannot be compared with another."""

    default_code = Code.TRAJECTORY


class ModelError(ReconError):
    """A model of a dive cannot be made of what is there, or cannot be judged."""

    default_code = Code.MODEL
