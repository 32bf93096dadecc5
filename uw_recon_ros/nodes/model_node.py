"""`model_node`: one model of the dive while it goes on, out of disparities and an odometry.

| topic | type | |
| --- | --- | --- |
| `odometry` | nav_msgs/Odometry | in, of the same stamp: `odometry_node`'s, or another's |
| `disparity` | stereo_msgs/DisparityImage | in |
| `disparity/sigma` | Image | in, where published |
| `rectified/left/image_rect_color` or `rectified/left/image_rect` | Image | in: colours, places seen again |
| `rectified/left/camera_info`, `rectified/right/camera_info` | CameraInfo | in, of the same stamp |
| `model/submap` | PointCloud2 | out: the submap that was closed last |
| `model/points` | PointCloud2 | out, transient local: all closed submaps |
| `model/surface` | Marker | out, transient local: the same as triangles |
| `/tf` | TFMessage | out by `publish_map_tf`: `map_frame` to odometry's frame |
| `~/save` | std_srvs/Trigger | writes mesh, cloud, maps and trajectory to `model_folder` |

Frames of which odometry tells nothing are not fused. `~/save` answers at once; ``/diagnostics`` (``save``) says what
became of it.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from std_srvs.srv import Trigger

from uw_recon_ros import rigid
from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.errors import EstimationError, ReconError
from uw_recon_ros.findings import Code
from uw_recon_ros.live.model import LiveModel
from uw_recon_ros.live.params import LiveModelParams
from uw_recon_ros.live.submap import warm_up
from uw_recon_ros.model.kept_frames import placed
from uw_recon_ros.model.live import KeyFrameFolder, expect_room, save_model
from uw_recon_ros.node_params import CloudParams, DisparityMessageParams, ModelNodeParams
from uw_recon_ros.ros.declared_topics import Input, input_topic, outputs_of
from uw_recon_ros.ros.disparity_frames import FRAME_INPUTS, disparity_frame, view_from_child
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.messages import cloud_message, surface_message, view_from_odometry
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.ros.process import run
from uw_recon_ros.ros.transforms import TF, send_transform
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Matrix

INPUTS = (*FRAME_INPUTS, Input("odometry", (input_topic("odometry"),)))
OUTPUTS = (*outputs_of("model_node"), *TF)


@dataclass
class Dive:
    """What is remembered from frame to frame."""

    model: LiveModel
    kept: KeyFrameFolder | None
    last_ns: int = -1
    on_disk: list[bool] = field(default_factory=list)


@dataclass(frozen=True)
class ModelStage:
    """The parameters, and the dive so far."""

    params: ParameterSet
    dive: Dive


class ModelNode(StageNode[ModelStage]):
    """Fuses the dive, submap by submap."""

    def __init__(self, **options: Any) -> None:
        classes = (ModelNodeParams, LiveModelParams, MountParams, DisparityMessageParams, CloudParams)
        self._saving: threading.Thread | None = None
        self._lock = threading.Lock()  # the model is read by who saves, and grown by the worker
        super().__init__("model_node", classes=classes, inputs=INPUTS, outputs=OUTPUTS, **options)
        self.create_service(Trigger, "~/save", self._save)

    def build(self, params: ParameterSet) -> ModelStage:
        """Make the stage; the dive goes on unless how it is modelled changes."""
        own = params[ModelNodeParams]
        if own.publish_map_tf and not TF:
            raise ValueError("publish_map_tf: expected tf2_msgs to be installed, it is not")
        before = self.stage
        same = (LiveModelParams, MountParams)
        if before is not None and all(before.params[kind] == params[kind] for kind in same):
            return ModelStage(params, before.dive)
        return ModelStage(params, Dive(LiveModel(params[LiveModelParams]), None))

    def works_unasked(self, params: ParameterSet) -> bool:
        """Whether something is to come of it that nobody has to listen to: files, or tf."""
        return bool(params[ModelNodeParams].publish_map_tf or params[ModelNodeParams].model_folder)

    def adapt_inputs(self, params: ParameterSet) -> None:
        """Give the images room to wait for what takes its time."""
        self.inputs.assembler.memory_bytes = params[CloudParams].image_memory_mb * 1_000_000

    def cleanup(self) -> None:
        """Free everything, the key frames on the disk included."""
        if (stage := self.stage) is not None and stage.dive.kept is not None:
            stage.dive.kept.remove()
        super().cleanup()

    def warm_up(self, stage: ModelStage) -> None:
        """Compile what fuses, or fetch it compiled."""
        warm_up()

    def work(self, stage: ModelStage, group: Group, outputs: Outputs) -> int:
        """Fuse one frame, if it shows enough that is new."""
        frame, frame_id = disparity_frame(group, stage.params)
        if not frame.geometry.metric:
            raise EstimationError("metric scale unknown: no model (calibrate)", Code.MODEL_NOT_METRIC)
        odometry = group["odometry"]
        child = odometry.child_frame_id
        expected, view = view_from_child(stage.params[MountParams], frame.geometry, frame_id)
        if child != expected:
            text = f"odometry: expected that of {expected!r}, got {child!r}: set base_frame, and the camera in it"
            raise EstimationError(text, Code.MODEL_POSES)
        pose, covariance = view_from_odometry(odometry, view)
        dive = self._dive(stage, frame.stamp_ns)
        closed = dive.model.wants(pose) and self._add(stage, dive, frame, pose, covariance)
        self._tell(stage, dive, frame.stamp_ns, odometry.header.frame_id, outputs, closed=closed)
        return frame.stamp_ns

    def _dive(self, stage: ModelStage, stamp: int) -> Dive:
        """The dive so far; a clock that was set back, as by a looped bag, begins another."""
        dive = stage.dive
        if stamp <= dive.last_ns:
            self.warn("clock", "stamps went back: the model begins anew")
            if dive.kept is not None:
                dive.kept.remove()
            vars(dive).update(vars(Dive(LiveModel(stage.params[LiveModelParams]), None)))
        dive.last_ns = stamp
        return dive

    def _add(self, stage: ModelStage, dive: Dive, frame: DisparityFrame, pose: Matrix, covariance: Matrix) -> bool:
        posed = placed(frame, pose)
        with self._lock:
            closed = dive.model.add(frame, posed, covariance)
            dive.on_disk.append(self._keep(stage, dive, frame))
        return closed

    def _keep(self, stage: ModelStage, dive: Dive, frame: DisparityFrame) -> bool:
        """Whether the frame is on the disk, for `~/save`."""
        if not stage.params[ModelNodeParams].model_folder:
            return False
        try:
            dive.kept = dive.kept or KeyFrameFolder()
            dive.kept.add(frame)
        except OSError as error:
            self.diagnostics.problem("keep", f"key frames cannot be kept for ~/save: {error}")
            return False
        self.diagnostics.problem("keep", None)
        return True

    def _tell(
        self, stage: ModelStage, dive: Dive, stamp: int, odom_frame: str, outputs: Outputs, *, closed: bool
    ) -> None:
        own, model = stage.params[ModelNodeParams], dive.model
        correction = model.correction
        moved = float(np.linalg.norm(rigid.log(correction)[:3]))
        self.diagnostics.say(
            key_frames=len(model.frames), submaps=len(model.submaps), loops=len(model.loops), corrected_m=f"{moved:.3f}"
        )
        if own.publish_map_tf:
            send_transform(outputs, stamp, own.map_frame, odom_frame, correction)
        if closed:
            outputs.send("model/submap", lambda: cloud_message(model.cloud(stamp, own.map_frame, last=True)))
            outputs.send("model/points", lambda: cloud_message(model.cloud(stamp, own.map_frame)))
            outputs.send("model/surface", lambda: surface_message(model.surface(stamp, own.map_frame)))

    def _save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Begin to write the model's files."""
        try:
            response.message = self._begin_to_save()
            response.success = True
        except ReconError as error:
            response.message = str(error)
        return response

    def _begin_to_save(self) -> str:
        stage = self.stage
        folder = "" if stage is None else stage.params[ModelNodeParams].model_folder
        if stage is None or not folder:
            raise EstimationError("expected model_folder, set before the dive, and an active node, got none")
        if self._saving is not None and self._saving.is_alive():
            raise EstimationError("expected the save before to be over, it is still under way")
        expect_room(folder)
        with self._lock:
            dive = stage.dive
            which = np.flatnonzero(dive.on_disk)
            stamps = [dive.model.frames[k].stamp_ns for k in which]
            poses = dive.model.poses[which].copy()
            kept = dive.kept
        if kept is None or len(which) < 2:
            raise EstimationError(f"expected at least two fused frames, got {len(which)}")
        paths = [kept.path(stamp) for stamp in stamps]
        self.diagnostics.say(save=f"writing {len(paths)} frames to {folder}")
        self._saving = threading.Thread(target=self._write, args=(folder, paths, stamps, poses), daemon=True)
        self._saving.start()
        return f"fusing {len(paths)} frames: {folder} appears when it is done; see 'save' on /diagnostics"

    def _write(self, folder: str, paths: list[Any], stamps: list[int], poses: Matrix) -> None:
        try:
            made = save_model(folder, paths, stamps, poses, lambda *_: None)
        except Exception as error:  # whatever it is, the node lives to tell
            self.diagnostics.say(save=f"failed: {error}")
            self.diagnostics.problem("save", f"the model was not saved: {error}")
            return
        self.diagnostics.say(save=f"done: {folder}, {made['triangles']} triangles")
        self.diagnostics.problem("save", None)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted; return the exit code."""
    return run(ModelNode, __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
