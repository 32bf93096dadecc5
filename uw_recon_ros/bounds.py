"""What input from others may cost, in one place: sizes, and the work of reading a bag. Counted, never timed.

An encoded image is looked at before it is decoded (`files.image_header`): decoding allocates at most `BYTES_PER_PIXEL`
for each pixel the image has, plus `SPARE_BYTES`, and the image has at most `LARGEST_PIXELS`. A bag costs memory and
steps in proportion to its file's size (`Budget`); what goes beyond is not read, and that is said.
"""

from __future__ import annotations

from dataclasses import dataclass

#: Pixels an encoded image may have: 8192 x 8192. A mono image then takes 64 MiB, 16-bit RGBA 512 MiB.
LARGEST_PIXELS = 2**26
#: Bytes that decoding may allocate for each pixel (16-bit RGBA, thrice, with what a decoder keeps beside it).
BYTES_PER_PIXEL = 32
#: Bytes that it may allocate besides, and the least limit on anything unpacked.
SPARE_BYTES = 2**26
#: Channels of an image.
MOST_CHANNELS = 4
#: Bytes of an image's file: that of 16-bit RGBA without compression.
LARGEST_IMAGE_FILE = 8 * LARGEST_PIXELS + 2**20
#: What a compressed chunk, message or file may become, in times its own size; beyond, up to `SPARE_BYTES` in all.
MOST_UNPACKED = 200
#: Records of a bag that are looked at: so many, and one more for so many bytes of its file.
SPARE_STEPS, BYTES_PER_STEP = 20_000, 4
#: Characters of quality-of-service descriptions parsed in one bag; a publisher's take some 300.
MOST_QOS_TEXT = 2**17


def unpacked_limit(packed: int) -> int:
    """Bytes that so many compressed bytes may become."""
    return max(SPARE_BYTES, MOST_UNPACKED * packed)


class OverBudgetError(ValueError):
    """More work than a file of this size is worth."""


@dataclass
class Budget:
    """Work that one walk through a file may cost.

    Parameters
    ----------
    steps : int
        Records still to be looked at.
    octets : int
        Bytes still to be unpacked.
    """

    steps: int
    octets: int

    @classmethod
    def of(cls, size: int) -> Budget:
        """For a file of `size` bytes."""
        return cls(SPARE_STEPS + size // BYTES_PER_STEP, 16 * SPARE_BYTES + MOST_UNPACKED * size)

    def step(self) -> None:
        """Look at one record. Raises `OverBudgetError`."""
        self.steps -= 1
        if self.steps < 0:
            raise OverBudgetError("more records than a file of this size holds: the rest is not read")

    def unpack(self, octets: int) -> None:
        """Unpack so many bytes. Raises `OverBudgetError`."""
        self.octets -= octets
        if self.octets < 0:
            raise OverBudgetError("it unpacks to far more than a recording of this size: the rest is not read")
