"""What all tests share."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

# In CI the same examples every time; elsewhere others each time, and a failure prints how to see it again.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("default", deadline=None, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")


@pytest.fixture(scope="session")
def kernels_compiled() -> None:
    """Have the kernels compiled: no node under test should wait for that, and no test for the node."""
    from uw_recon_ros.match.methods import EFFORTS
    from uw_recon_ros.match.stage import Match, MatchParams
    from uw_recon_ros.warm import warm_up

    warm_up()
    for effort in EFFORTS:
        Match(MatchParams(effort=effort)).warm_up()
