"""Underwater stereo reconstruction: a ROS 2 node graph, a command line, and what stands below for Python.

Nothing is loaded until it is asked for, so that an import takes no time. See ``docs/python.md``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uw_recon_ros.lazy_import import on_demand

if TYPE_CHECKING:
    from uw_recon_ros.api import (
        calibrate,
        enhance,
        match,
        measure,
        measure_model,
        open_recording,
        pairs,
        read_parameters,
        reconstruct,
        rectify,
    )
    from uw_recon_ros.errors import BagError, CalibrationError, EstimationError, ImageError, ReconError
    from uw_recon_ros.files.calibrations import read_calibration, write_calibration
    from uw_recon_ros.files.disparities import read_disparity, write_disparity
    from uw_recon_ros.files.images import read_image, write_image
    from uw_recon_ros.files.meshes import write_glb, write_ply
    from uw_recon_ros.findings import Code, Finding, Severity
    from uw_recon_ros.match.stage import MatchParams
    from uw_recon_ros.pipeline import Pipeline, PipelineParams, Products
    from uw_recon_ros.preprocess.stage import PreprocessParams
    from uw_recon_ros.reconstruct.stage import ReconstructParams
    from uw_recon_ros.rectify.params import RectifyParams
    from uw_recon_ros.types import (
        CameraModel,
        DepthMap,
        DisparityMap,
        EnhancedPair,
        Matches,
        PointCloud,
        RectifiedPair,
        Status,
        StereoCalibration,
        StereoGeometry,
        StereoPair,
        Surface,
    )

    __version__: str

_PLACES = {
    "api": (
        "calibrate",
        "enhance",
        "match",
        "measure",
        "measure_model",
        "open_recording",
        "pairs",
        "read_parameters",
        "reconstruct",
        "rectify",
    ),
    "files.calibrations": ("read_calibration", "write_calibration"),
    "errors": ("BagError", "CalibrationError", "EstimationError", "ImageError", "ReconError"),
    "files.disparities": ("read_disparity", "write_disparity"),
    "findings": ("Code", "Finding", "Severity"),
    "files.images": ("read_image", "write_image"),
    "match.stage": ("MatchParams",),
    "pipeline": ("Pipeline", "PipelineParams", "Products"),
    "preprocess.stage": ("PreprocessParams",),
    "files.meshes": ("write_glb", "write_ply"),
    "reconstruct.stage": ("ReconstructParams",),
    "rectify.params": ("RectifyParams",),
    "types": (
        "CameraModel",
        "DepthMap",
        "DisparityMap",
        "EnhancedPair",
        "Matches",
        "PointCloud",
        "RectifiedPair",
        "Status",
        "StereoCalibration",
        "StereoGeometry",
        "StereoPair",
        "Surface",
    ),
}
_look_up = on_demand(__name__, _PLACES)

__all__ = [  # noqa: RUF022  (verbs, files, parameters, nouns, errors)
    "enhance",
    "rectify",
    "match",
    "reconstruct",
    "calibrate",
    "measure",
    "measure_model",
    "open_recording",
    "pairs",
    "read_calibration",
    "write_calibration",
    "read_parameters",
    "read_image",
    "write_image",
    "read_disparity",
    "write_disparity",
    "write_ply",
    "write_glb",
    "Pipeline",
    "PipelineParams",
    "PreprocessParams",
    "RectifyParams",
    "MatchParams",
    "ReconstructParams",
    "StereoPair",
    "StereoCalibration",
    "CameraModel",
    "EnhancedPair",
    "RectifiedPair",
    "Matches",
    "DisparityMap",
    "Status",
    "StereoGeometry",
    "DepthMap",
    "PointCloud",
    "Surface",
    "Products",
    "Finding",
    "Code",
    "Severity",
    "ReconError",
    "ImageError",
    "CalibrationError",
    "EstimationError",
    "BagError",
]


def __getattr__(name: str) -> object:
    if name == "__version__":  # package.xml is its one place
        from importlib.metadata import version

        return version(__name__)
    return _look_up(name)


def __dir__() -> list[str]:
    return [*globals(), *__all__, "__version__"]
