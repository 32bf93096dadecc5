"""What a node has from configuration to clean-up: a stage, publishers, and a thread that works.

The thread cannot be interrupted, so it may outlive the session, and the node. It touches ROS through `Outputs` alone,
which are closed first; so whatever is destroyed afterwards, nobody is using.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

from uw_recon_ros.errors import ReconError
from uw_recon_ros.findings import Code
from uw_recon_ros.ros.diagnostics import DEACTIVATED, SUPERSEDED, Diagnostics
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.outputs import Outputs, Publishers
from uw_recon_ros.ros.worker import Worker

S = TypeVar("S")
Taken = TypeVar("Taken", contravariant=True)
_LONGEST_LATENCY_S = 3600.0
_WORTH_TELLING_S = 2.0


class Host(Protocol[Taken]):
    """What a session needs of the node it belongs to."""

    diagnostics: Diagnostics

    def get_name(self) -> str:
        """Name of the node."""

    def get_clock(self) -> Any:
        """Its clock."""

    def warn(self, key: str, text: str) -> None:
        """Log a warning, not too often."""

    def warm_up(self, stage: Taken) -> None:
        """Prepare a stage for its first frame."""

    def work(self, stage: Taken, group: Group, outputs: Outputs) -> int:
        """Work on one group; return its stamp, ns."""

    def finished(self, stage: Taken, took_s: float) -> None:
        """Hear how long a frame took."""


class WarmUp:
    """How far the preparation for the first frame is: noted by the worker's thread, told by the executor's."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._took_s: float | None = None
        self._told = 0

    @property
    def running(self) -> bool:
        """Whether it goes on."""
        return self._took_s is None

    def done(self) -> None:
        """Note that it is over."""
        self._took_s = time.monotonic() - self._began

    def news(self) -> str | None:
        """Return what is worth a line in the log, once: that it takes long, and then that it is over."""
        if self._told == 0 and self.running and time.monotonic() - self._began > _WORTH_TELLING_S:
            self._told = 1
            return "first start: compiling kernels, about a minute; nothing comes out until then"
        if self._told == 1 and self._took_s is not None:
            self._told = 2
            return f"compiled in {self._took_s:.1f} s"
        return None


class NodeSession(Generic[S]):
    """One configuration of a node at work.

    Methods belong to the executor's thread.

    Parameters
    ----------
    node : Host
    stage : object
        What `StageNode.build` made.
    publishers : Publishers

    Attributes
    ----------
    stage : object
        Replaced when parameters change; a frame keeps the one it began with.
    outputs : Outputs
        Of the last activation; closed while the node is not active.
    warm_up : WarmUp
    """

    def __init__(self, node: Host[S], stage: S, publishers: Publishers) -> None:
        self._node, self._diagnostics, self._publishers = node, node.diagnostics, publishers
        self.stage = stage
        self.outputs = Outputs(publishers, self._diagnostics)
        self.outputs.close()
        self.warm_up = WarmUp()
        self._worker: Worker[tuple[Outputs, Group]] = Worker(node.get_name(), self._work, self._begin)

    def open(self) -> None:
        """Let what is posted from now on be worked on and sent."""
        self.outputs = Outputs(self._publishers, self._diagnostics)

    def post(self, group: Group) -> None:
        """Leave a group for the thread; the newest wins."""
        if self._worker.mailbox.put((self.outputs, group)):
            self._diagnostics.drop(SUPERSEDED)

    @property
    def busy(self) -> bool:
        """Whether a group waits or is being worked on, or the preparation goes on."""
        return self.warm_up.running or self._worker.mailbox.busy

    def discard(self) -> None:
        """Drop the group that waits."""
        if self._worker.mailbox.clear():
            self._diagnostics.drop(DEACTIVATED)

    def close(self) -> None:
        """Send nothing more, drop what waits."""
        self.outputs.close()
        self.discard()

    def end(self) -> Callable[[float], bool]:
        """Free everything; return what waits for the thread, so many seconds, and tells whether it has ended."""
        self.close()
        self._worker.stop(0.0)
        self._publishers.destroy()
        return self._worker.stop

    # What follows runs in the worker's thread.

    def _begin(self) -> None:
        try:
            self._node.warm_up(self.stage)
        except Exception as error:  # the first frame will meet it again, and report it
            self._diagnostics.problem("warm_up", f"warm-up: {error!r}")
        self.warm_up.done()

    def _work(self, task: tuple[Outputs, Group]) -> None:
        outputs, group = task
        stage, started = self.stage, time.monotonic()
        try:
            stamp_ns = self._node.work(stage, group, outputs)
            took_s = time.monotonic() - started
            self._node.finished(stage, took_s)
        except (ReconError, ValueError) as error:
            self._failed(outputs, type(error).__name__, str(error), code=getattr(error, "code", None))
        except Exception as error:  # a bug of ours, or of a library: the node must live to report it
            text = f"internal error: {error!r}"
            self._failed(outputs, f"internal {type(error).__name__}", text, traceback.format_exc())
        else:
            self._done(outputs, stamp_ns, took_s)

    def _done(self, outputs: Outputs, stamp_ns: int, took_s: float) -> None:
        if not outputs.open:
            self._diagnostics.drop(DEACTIVATED)
            return
        self._diagnostics.count("done")
        self._diagnostics.measure("work", took_s)
        latency_s = (self._node.get_clock().now().nanoseconds - stamp_ns) * 1e-9
        if abs(latency_s) < _LONGEST_LATENCY_S:  # else the stamps are not of this clock: a replay without use_sim_time
            self._diagnostics.measure("latency", latency_s)

    def _failed(self, outputs: Outputs, reason: str, text: str, details: str = "", code: Code | None = None) -> None:
        if not outputs.open:
            self._diagnostics.drop(DEACTIVATED)
            return
        self._diagnostics.drop(reason, text, code=code)
        line = f"frame dropped: {text}" + (f"\n{details}" if details else "")
        self._node.warn(f"{reason} {text[:40]}", line)
