"""`odometry_node`: where the vehicle has come since the start, by what the left camera sees of the bottom.

| topic | type | |
| --- | --- | --- |
| `disparity` | stereo_msgs/DisparityImage | in |
| `disparity/sigma` | Image | in, where published |
| `rectified/left/image_rect_color` or `rectified/left/image_rect` | Image | in: corners that are followed |
| `rectified/left/camera_info`, `rectified/right/camera_info` | CameraInfo | in, of the same stamp |
| `odometry` | nav_msgs/Odometry | out: pose and velocity with covariance; nothing while lost |
| `path` | nav_msgs/Path | out, transient local |
| `/tf` | TFMessage | out by `publish_tf`: `odom_frame` to `base_frame` |

The pose never jumps. While no frame hangs together with those before it nothing is published, and ``/diagnostics`` says
so; where the way goes on afterwards, it does so from the last pose, with a covariance that holds where the vehicle may
be by then.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.camera_mount import BODY_FROM_OPTICAL, MountParams
from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.node_params import CloudParams, DisparityMessageParams, OdometryNodeParams
from uw_recon_ros.ros.declared_topics import outputs_of
from uw_recon_ros.ros.disparity_frames import FRAME_INPUTS, disparity_frame, view_from_child
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.messages import odometry_message, path_message
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.ros.process import run
from uw_recon_ros.ros.transforms import TF, send_transform
from uw_recon_ros.track.odometry import Odometer, Step, vehicle_state
from uw_recon_ros.track.params import OdometryParams
from uw_recon_ros.trajectory import VehicleState, pose_matrix
from uw_recon_ros.types import Matrix

INPUTS = FRAME_INPUTS
OUTPUTS = (*outputs_of("odometry_node"), *TF)
_PATH_EVERY_NS = 500_000_000


@dataclass
class Way:
    """What is remembered from frame to frame."""

    odometer: Odometer
    last_ns: int = -1
    lost_since_ns: int | None = None
    stamps_ns: list[int] = field(default_factory=list)
    poses: list[Matrix] = field(default_factory=list)
    told_ns: int = 0

    def note(self, state: VehicleState, spacing_m: float, most: int) -> None:
        """Keep a pose for the path; where they are many, every second one."""
        if self.poses and np.linalg.norm((state.pose - self.poses[-1])[:3, 3]) < spacing_m:
            return
        self.stamps_ns.append(state.stamp_ns)
        self.poses.append(state.pose)
        if len(self.poses) > most:
            self.stamps_ns, self.poses = self.stamps_ns[::2], self.poses[::2]


@dataclass(frozen=True)
class OdometryStage:
    """The parameters, and the way so far."""

    params: ParameterSet
    way: Way


class OdometryNode(StageNode[OdometryStage]):
    """Follows the bottom from frame to frame."""

    def __init__(self, **options: Any) -> None:
        classes = (OdometryNodeParams, OdometryParams, MountParams, DisparityMessageParams, CloudParams)
        super().__init__("odometry_node", classes=classes, inputs=INPUTS, outputs=OUTPUTS, **options)

    def build(self, params: ParameterSet) -> OdometryStage:
        """Make the stage; the way goes on unless what it is found with changes."""
        own = params[OdometryNodeParams]
        if own.publish_tf and not TF:
            raise ValueError("publish_tf: expected tf2_msgs to be installed, it is not: only odometry is published")
        if own.publish_tf and not params[MountParams].base_frame:
            raise ValueError("publish_tf: expected base_frame, and where the left camera sits in it, got none")
        before = self.stage
        same = (OdometryParams, MountParams)
        goes_on = before is not None and all(before.params[kind] == params[kind] for kind in same)
        way = before.way if before is not None and goes_on else Way(Odometer(params[OdometryParams]))
        return OdometryStage(params, way)

    def works_unasked(self, params: ParameterSet) -> bool:
        """Whether tf is to be told: whoever needs it listens to /tf, as everybody does."""
        return params[OdometryNodeParams].publish_tf

    def adapt_inputs(self, params: ParameterSet) -> None:
        """Give the images room to wait for a disparity that takes its time."""
        self.inputs.assembler.memory_bytes = params[CloudParams].image_memory_mb * 1_000_000

    def work(self, stage: OdometryStage, group: Group, outputs: Outputs) -> int:
        """Join one frame to those before it."""
        frame, frame_id = disparity_frame(group, stage.params)
        if not frame.geometry.metric:
            text = "metric scale unknown: no odometry (calibrate, or set baseline_m and focal_px)"
            raise EstimationError(text, Code.ODOMETRY_NOT_METRIC)
        step = self._way(stage, frame.stamp_ns).odometer.add(frame)
        self._tell(stage, step, view_from_child(stage.params[MountParams], frame.geometry, frame_id), outputs)
        return frame.stamp_ns

    def _way(self, stage: OdometryStage, stamp_ns: int) -> Way:
        """The way so far; a clock that was set back, as by a looped bag, begins another."""
        way = stage.way
        if stamp_ns <= way.last_ns:
            self.warn("clock", "stamps went back: the way begins anew")
            vars(way).update(vars(Way(Odometer(stage.params[OdometryParams]))))
        way.last_ns = stamp_ns
        return way

    def _tell(self, stage: OdometryStage, step: Step, seen_from: tuple[str, Matrix], outputs: Outputs) -> None:
        way, own = stage.way, stage.params[OdometryNodeParams]
        self._report(way, step)
        if step.lost:
            return
        child, view = seen_from
        upright = np.eye(4) if stage.params[MountParams].base_frame else pose_matrix(np.zeros(3), BODY_FROM_OPTICAL)
        state = vehicle_state(step, own.odom_frame, child, upright @ rigid.inverse(view), view)
        outputs.send("odometry", lambda: odometry_message(state))
        if own.publish_tf:
            send_transform(outputs, state.stamp_ns, state.frame_id, state.child_frame_id, state.pose)
        way.note(state, own.path_spacing_m, own.path_poses)
        if state.stamp_ns - way.told_ns >= _PATH_EVERY_NS:
            way.told_ns = state.stamp_ns
            outputs.send("path", lambda: path_message(way.stamps_ns, way.poses, state.frame_id))

    def _report(self, way: Way, step: Step) -> None:
        """Say whether the way is known, and how sure it is."""
        findings = []
        if step.lost:
            way.lost_since_ns = way.lost_since_ns or step.stamp_ns
            seconds = (step.stamp_ns - way.lost_since_ns) * 1e-9
            text = f"lost for {seconds:.1f} s: too little in common with the frames before; no odometry"
            advice = "slower, nearer to the bottom, or more light"
            findings.append(Finding(Code.ODOMETRY_LOST, text, Severity.REFUSED, advice))
        else:
            way.lost_since_ns = None
        if step.resumed_after_s:
            text = (
                f"went on after {step.resumed_after_s:.1f} s without sight: the way meanwhile is in the covariance only"
            )
            self.warn(Code.ODOMETRY_RESUMED.value, text)
        self.diagnostics.found("odometry", findings)
        sigma = float(np.sqrt(np.trace(step.covariance[:3, :3])))
        self.diagnostics.say(
            tracking="lost" if step.lost else str(step.status),
            inliers=step.inliers,
            position_sigma_m=None if step.lost else f"{sigma:.3f}",
        )


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted; return the exit code."""
    return run(OdometryNode, __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
