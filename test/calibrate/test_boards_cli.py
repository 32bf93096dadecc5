"""What the command line offers of boards."""

from __future__ import annotations

from uw_recon_ros import boards
from uw_recon_ros.cli import calibrate


def test_it_offers_every_kind_of_board() -> None:
    assert calibrate.KINDS == boards.KINDS
