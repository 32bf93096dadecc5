"""The rectification stage: warp an enhanced pair so that matching pixels share a row (a column, for a vertical rig)."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.errors import ImageError
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.warp import read_at, warp_unseen
from uw_recon_ros.types import ByteImage, EnhancedPair, FloatImage, Mask, RectifiedPair, named_frame
from uw_recon_ros.unseen_pixels import blackened, continued, mark_unseen, unseen

__all__ = ["Rectify", "RectifyParams"]


@dataclass(frozen=True)
class Rectify:
    """Apply a rectification; what rectification a pair needs, `RigTracker` knows.

    Parameters
    ----------
    params : RectifyParams
    """

    params: RectifyParams

    def __call__(self, pair: EnhancedPair, rectification: Rectification) -> RectifiedPair:
        """Warp the four images of a pair; two where it has no pictures.

        Parameters
        ----------
        pair : EnhancedPair
        rectification : Rectification
            Of images of this size.

        Returns
        -------
        RectifiedPair
            Both views of one size; stamp as it came, frame as `image_frame` names it.

        Raises
        ------
        ImageError
            An image is of another size than the rectification was made for.
        """
        _check_sizes(pair, rectification)
        outside = rectification.outside
        left, left_matching = self._warped(pair.left, pair.left_matching, rectification.left_map, outside[0])
        right, right_matching = self._warped(pair.right, pair.right_matching, rectification.right_map, outside[1])
        return RectifiedPair(
            left=left,
            right=right,
            left_matching=left_matching,
            right_matching=right_matching,
            geometry=rectification.geometry,
            quality=rectification.quality,
            valid_left=rectification.valid_left,
            valid_right=rectification.valid_right,
            stamp_ns=pair.stamp_ns,
            frame_id=named_frame(pair.frame_id, self.params.image_frame),
        )

    def _warped(
        self, shown: ByteImage, matching: ByteImage, raw_from_rect: FloatImage | None, outside: Mask | None
    ) -> tuple[ByteImage, ByteImage]:
        """Both images of a camera; what the raw image does not show stays black."""
        if raw_from_rect is None:
            return shown, matching
        missing = unseen(matching)
        hidden = warp_unseen(missing, raw_from_rect, outside)

        def warped(image: ByteImage) -> ByteImage:
            return read_at(continued(image, missing), raw_from_rect, self.params.rectify_interpolation)

        to_match = mark_unseen(warped(matching), hidden)
        return to_match if shown is matching else blackened(warped(shown), hidden), to_match


def _check_sizes(pair: EnhancedPair, rectification: Rectification) -> None:
    expected = rectification.raw_height, rectification.raw_width
    for name in ("left", "right", "left_matching", "right_matching"):
        got = getattr(pair, name).shape[:2]
        if got != expected:
            raise ImageError(
                f"{name} image: expected {expected[1]}x{expected[0]} px as rectified before, got {got[1]}x{got[0]}"
            )
