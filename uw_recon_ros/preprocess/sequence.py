"""Frames in a row: what one camera shows unchanged since the frame before, while the other moves on, is frozen."""

from __future__ import annotations

from uw_recon_ros.preprocess.regions import RegionWatch
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.types import EnhancedPair, StereoPair


class PreprocessSequence:
    """`Preprocess` with a memory of the last pair. Deterministic: the same frames in a row give the same results.

    Parameters
    ----------
    params : PreprocessParams
    """

    def __init__(self, params: PreprocessParams) -> None:
        self._preprocess = Preprocess(params)
        self._regions = RegionWatch()

    def __call__(self, pair: StereoPair, *, shown: bool = True) -> EnhancedPair:
        """Enhance the next pair; `shown` as in `Preprocess`.

        Raises
        ------
        ImageError, TypeError
            As `Preprocess`.
        """
        return self._preprocess(pair, self._regions.update(pair), shown=shown)
