"""The matching stage in a node: at the effort asked for, or at the one that holds a rate."""

from __future__ import annotations

import time
from dataclasses import replace

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.sequence import MatchSequence
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.node_params import RateParams
from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.effort_control import EffortGovernor
from uw_recon_ros.types import DisparityMap, RectifiedPair

_TARGET, _POSSIBLE = "target [Hz]", "possible [Hz]"


class NodeMatcher:
    """`Match`, with ``target_rate_hz``: ``effort`` is then the most that is spent.

    Nothing but the effort is lowered: fewer disparities or pixels would hide what is there. Used by the worker's thread
    alone, once made.

    Parameters
    ----------
    params : MatchParams
    rate : RateParams

    Attributes
    ----------
    spent : str
        Effort of the last pair; empty before the first, and for a method that has none.
    """

    def __init__(self, params: MatchParams, rate: RateParams) -> None:
        self.params, self.rate = params, rate
        self._governor: EffortGovernor | None = None
        efforts: tuple[str, ...] = (params.effort,)
        if rate.target_rate_hz > 0:
            if params.method == "graph_cut":
                efforts = EFFORTS[: EFFORTS.index(params.effort) + 1]
            self._governor = EffortGovernor(efforts, 1 / rate.target_rate_hz, rate.better_every)
        self._matches = {effort: Match(replace(params, effort=effort)) for effort in efforts}
        self._sequence = MatchSequence()
        self._matched_s: float | None = None
        self._limits: tuple[int, int] | None = None
        self.spent = ""

    @property
    def effort(self) -> str:
        """What is spent on the next pair."""
        return self._governor.effort if self._governor is not None else self.params.effort

    def warm_up(self) -> None:
        """Compile the matcher, or fetch it compiled, for every effort that may be used."""
        for match in self._matches.values():
            match.warm_up()

    def __call__(self, pair: RectifiedPair) -> DisparityMap:
        """Match one pair. Where it does not show the limits of its disparities, those of the pair before hold."""
        began = time.monotonic()
        effort = self.effort
        try:
            found = self._sequence(self._matches[effort], pair)
        except EstimationError as error:
            if error.code != Code.MATCH_NO_RANGE or self._limits is None:
                raise
            low, high = self._limits  # open water, darkness: an answer that knows nothing is better than none
            given = replace(self._matches[effort].params, min_disparity=low, max_disparity=high)
            found = self._sequence(Match(given), pair)
        self._limits = found.min_disparity, found.max_disparity
        self.spent = effort if self.params.method == "graph_cut" else ""
        self._matched_s = time.monotonic() - began
        return found

    def finished(self, took_s: float, diagnostics: Diagnostics) -> None:
        """Take note of how long the node's work on a frame took, s, and report."""
        matched_s, self._matched_s = self._matched_s, None
        if matched_s is None:  # nobody listened that far
            return
        spent = self.spent or None
        diagnostics.say(effort=spent)
        if self._governor is None:
            diagnostics.say(**dict.fromkeys((_TARGET, _POSSIBLE)))
            diagnostics.problem("rate", None)
            return
        self._governor.record(matched_s, took_s - matched_s)
        target_hz = self.rate.target_rate_hz
        diagnostics.say(**{_TARGET: f"{target_hz:g}", _POSSIBLE: f"{1 / max(took_s, 1e-9):.2f}"})
        least = f"effort {spent}" if spent else self.params.method
        text = f"target_rate_hz: {target_hz:g} Hz missed even with {least}"
        diagnostics.problem("rate", text if self._governor.missed else None)
