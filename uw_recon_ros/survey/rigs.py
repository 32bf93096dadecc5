"""The different calibrations that occur in a survey, each kept once."""

from __future__ import annotations

from uw_recon_ros.types import CameraModel, StereoCalibration

_Key = tuple[bytes | str | int, ...]


class Rigs:
    """Numbers calibrations in the order they appear.

    Parameters
    ----------
    given : StereoCalibration, optional
        Taken instead of any other.

    Attributes
    ----------
    calibrations : list of StereoCalibration
    """

    def __init__(self, given: StereoCalibration | None = None) -> None:
        self.calibrations: list[StereoCalibration] = []
        self._given = given
        self._numbers: dict[_Key, int] = {}
        self._last: tuple[StereoCalibration, int] | None = None

    def index(self, found: StereoCalibration | None) -> int:
        """Number of a calibration; -1 for none."""
        calibration = self._given or found
        if calibration is None:
            return -1
        if self._last and self._last[0].left is calibration.left and self._last[0].right is calibration.right:
            return self._last[1]
        key = (*_key(calibration.left), *_key(calibration.right))
        if key not in self._numbers:
            self._numbers[key] = len(self.calibrations)
            self.calibrations.append(calibration)
        self._last = calibration, self._numbers[key]
        return self._numbers[key]


def _key(camera: CameraModel) -> _Key:
    arrays = (camera.k, camera.d, camera.r, camera.p)
    return (camera.width, camera.height, camera.distortion_model, camera.frame_id, *(a.tobytes() for a in arrays))
