"""What the data did wrong, with the numbers in the text.

A caller's mistake is a plain ``ValueError`` or ``TypeError``; these errors are for images, calibrations and bags.
They are caught in two places only: the node shell (frame dropped, counted, reported) and the command line.
"""


class ReconError(Exception):
    """Base of all errors that the data, not the caller, caused."""


class MessageError(ReconError):
    """A message's header makes no sense: its stamp, or the name of its frame."""


class ImageError(ReconError):
    """An image or image message cannot be read: size, step, encoding, truncated data."""


class CalibrationError(ReconError):
    """A calibration is missing, inconsistent, or does not describe a stereo rig."""


class EstimationError(ReconError):
    """A quantity cannot be estimated from these images: too few matches, forward motion, exchanged eyes."""


class BagError(ReconError):
    """A bag cannot be read or written, or does not hold what was asked of it."""
