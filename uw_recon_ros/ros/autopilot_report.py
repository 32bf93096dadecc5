"""Why `obstacles` and `range` say what they say, or nothing: keys of these names on ``/diagnostics``."""

from __future__ import annotations

import time

from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.outputs import Outputs

TOPICS = ("obstacles", "range")


class AutopilotReport:
    """What stands under both keys: what the last frame told, unless something keeps frames or listeners away.

    Parameters
    ----------
    diagnostics : Diagnostics
    """

    def __init__(self, diagnostics: Diagnostics) -> None:
        self._diagnostics = diagnostics
        self._told: dict[str, str] = {}
        self._since = time.monotonic()

    def frame(self, **told: str) -> None:
        """Note what a frame told on each topic. In the worker's thread."""
        self._told, self._since = told, time.monotonic()

    def say(self, outputs: Outputs, patience_s: float) -> None:
        """Set both keys. Once a second, in the executor's thread.

        Parameters
        ----------
        outputs : Outputs
            Those of the last activation.
        patience_s : float
            Without a frame for so long, none is under way.
        """
        if not outputs.open or not outputs.wanted(*TOPICS):
            self._told, self._since = {}, time.monotonic()
        waited = time.monotonic() - self._since
        for topic in TOPICS:
            if not outputs.open:
                text = "not published: the node is not active"
            elif not outputs.wanted(topic):
                text = f"not published: nobody listens to {topic}"
            elif waited > patience_s:
                text = f"not published: no pair came through for {waited:.0f} s, see silent, unpaired and last drop"
            else:
                text = self._told.get(topic, "waiting for a pair")
            self._diagnostics.say(**{topic: text})
