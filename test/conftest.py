"""What all tests share."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def kernels_compiled() -> None:
    """Have the kernels compiled: no node under test should wait for that, and no test for the node."""
    from uw_recon_ros.match.methods import EFFORTS
    from uw_recon_ros.match.stage import Match, MatchParams
    from uw_recon_ros.warm import warm_up

    warm_up()
    for effort in EFFORTS:
        Match(MatchParams(effort=effort)).warm_up()
