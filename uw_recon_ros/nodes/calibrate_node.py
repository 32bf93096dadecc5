"""`calibrate_node`: pairs of a board gathered from the running cameras, and the rig's calibration from them.

| topic | type | |
| --- | --- | --- |
| `left/image_raw`, `right/image_raw` or a transport of theirs, as `preprocess_node` has them | Image ... | in |
| `calibration/coverage` | Image bgr8 | out: both pictures, the board's points, parts that are covered, what to do |

Service (std_srvs/Trigger): ~/calibrate solves with the pairs there are and writes into `calibration_dir`, in the
background; ``/diagnostics`` says when it is there, how many pairs there are, and how much of both images they cover.
What has not been written when the node ends is written then. Works though nobody listens.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from std_srvs.srv import Trigger

from uw_recon_ros import stop_signals
from uw_recon_ros.calibrate.coverage import covered
from uw_recon_ros.calibrate.fit import LEAST_PAIRS
from uw_recon_ros.calibrate_files import BoardAsked, Seen, write_result
from uw_recon_ros.calibrate_live import LiveSession, Looked, annotated
from uw_recon_ros.errors import CalibrationError, ReconError
from uw_recon_ros.files.atomic import claim_folder, is_taken
from uw_recon_ros.images import as_gray
from uw_recon_ros.node_params import CalibrateNodeParams, CameraParams
from uw_recon_ros.nodes.preprocess_node import CAMERAS, camera_filter
from uw_recon_ros.ros.declared_topics import outputs_of
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.messages import header, image_message
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.pairs import raw_pair
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.ros.process import run

OUTPUTS = outputs_of("calibrate_node")


@dataclass(frozen=True)
class CalibrateStage:
    """The parameters, and the pairs so far."""

    params: CalibrateNodeParams
    session: LiveSession


class CalibrateNode(StageNode[CalibrateStage]):
    """Gathers pairs of a board, and calibrates.

    Attributes
    ----------
    looked : int
        Pairs looked at so far.
    """

    def __init__(self, **options: Any) -> None:
        self._saving, self._saved, self.looked, self._written = threading.Lock(), 0, 0, ""
        super().__init__(
            "calibrate_node", classes=(CameraParams, CalibrateNodeParams), inputs=CAMERAS, outputs=OUTPUTS, **options
        )
        self.create_service(Trigger, "~/calibrate", self._on_calibrate)

    def build(self, params: ParameterSet) -> CalibrateStage:
        """Make the stage; the pairs stay unless the board changes."""
        own, before = params[CalibrateNodeParams], self.stage
        folder, written = own.calibration_dir, before is not None and own.calibration_dir == self._written
        if folder and not written and not own.calibration_overwrite and is_taken(Path(folder)):
            raise ValueError(
                f"calibration_dir: expected a new or empty folder, got {folder} with files; "
                "calibration_overwrite: true replaces them"
            )
        columns, rows = own.board_columns, own.board_rows
        if (columns == 0) != (rows == 0):
            raise ValueError(f"board_columns, board_rows: expected both or none, got {columns} and {rows}")
        asked = BoardAsked(
            own.board, (columns, rows) if columns else None, own.board_square_mm / 1e3, own.board_marker_mm / 1e3,
            own.board_dictionary,
        )  # fmt: skip
        if before is not None and before.session.asked == asked:
            before.session.medium, before.session.most = own.board_medium, own.calibration_pairs
            return CalibrateStage(own, before.session)
        try:
            return CalibrateStage(own, LiveSession(asked, own.board_medium, own.calibration_pairs))
        except CalibrationError as error:
            raise ValueError(f"board: {error}") from error

    def works_unasked(self, params: ParameterSet) -> bool:
        """Pairs are gathered though nobody looks on."""
        return True

    def adapt_inputs(self, params: ParameterSet) -> None:
        """Take the image transport and the rate that are asked for."""
        self.inputs.accepts = camera_filter(params[CameraParams])
        self.inputs.pace.limit_hz = params[CameraParams].max_rate_hz
        self._most_pixels = params[CameraParams].max_pixels

    def work(self, stage: CalibrateStage, group: Group, outputs: Outputs) -> int:
        """Look for the board in one pair."""
        pair = raw_pair(group, most_pixels=self._most_pixels)
        seen = Seen(f"pair at {pair.stamp_ns / 1e9:.3f} s", as_gray(pair.left), as_gray(pair.right))
        looked = stage.session.add(seen)
        self._tell(stage.session, looked)
        self.looked += 1
        head = header(pair.stamp_ns, pair.frame_id)
        outputs.send("calibration/coverage", lambda: image_message(annotated(seen, looked, stage.session), head))
        return pair.stamp_ns

    def _tell(self, session: LiveSession, looked: Looked) -> None:
        left, right = session.near
        self.diagnostics.say(
            pairs=len(session.pairs), coverage_left=f"{covered(left):.2f}", coverage_right=f"{covered(right):.2f}",
            board=session.board or "not found yet", last_pair=looked.note or "kept", advice=session.advice(),
        )  # fmt: skip

    def _on_calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        stage = self.stage
        count = 0 if stage is None else len(stage.session.pairs)
        if stage is None or not stage.params.calibration_dir:
            response.message = "expected calibration_dir, a folder to write to, got none"
        elif count < LEAST_PAIRS:
            response.message = f"expected at least {LEAST_PAIRS} pairs, got {count}"
        elif self._saving.locked():
            response.message = "a calibration is under way already"
        else:
            threading.Thread(target=self._save, args=(stage,), daemon=True).start()
            response.success = True
            response.message = (
                f"{len(stage.session.pairs)} pairs: see /diagnostics, then {stage.params.calibration_dir}"
            )
        return response

    def _save(self, stage: CalibrateStage) -> None:
        """Solve and write; what does not go is told, and the pairs stay."""
        with self._saving:
            count, folder = len(stage.session.pairs), Path(stage.params.calibration_dir)
            self.diagnostics.say(calibration=f"solving with {count} pairs")
            try:
                own = stage.params.calibration_dir == self._written
                claim_folder(folder, own or stage.params.calibration_overwrite)
                report = write_result(stage.session.solve(), folder)
            except (ReconError, OSError) as error:
                self.diagnostics.say(calibration="failed")
                self.diagnostics.problem("calibration", f"calibration: {error}")
                return
            self._saved, self._written = count, stage.params.calibration_dir
            self.diagnostics.problem("calibration", None)
            used, unreliable = len(report["pairs"]), "" if report["reliable"] else ", NOT RELIABLE"
            told = f"{folder}: {used} pairs, reprojection error {report['rms_px']:.2f} px{unreliable}"
            self.diagnostics.say(calibration=told)
            self.get_logger().info(told)

    def stop(self, timeout_s: float = 1.0) -> bool:
        """Shut down; what has not been written is written first, where there is a folder and enough for it."""
        stage = self.stage
        if stage is not None and stage.params.calibration_dir:
            self.inputs.deactivate()
            with self._saving:  # what is under way
                count = len(stage.session.pairs)
            if count < LEAST_PAIRS:
                self.get_logger().warning(f"no calibration: expected at least {LEAST_PAIRS} pairs, got {count}")
            elif count > self._saved:
                self.get_logger().info(f"calibrating with {count} pairs; Ctrl-C once more gives them up")
                self._save(stage)
        return super().stop(timeout_s)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted, and calibrate; return the exit code."""
    stop_signals.finish_first()
    return run(CalibrateNode, __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
