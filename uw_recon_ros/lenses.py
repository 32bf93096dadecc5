"""Names of the models of lenses that can be calibrated, apart from their mathematics: help need not wait for numpy."""

from __future__ import annotations

PLUMB_BOB, EQUIDISTANT = "plumb_bob", "equidistant"
AUTO = "auto"  #: the one that predicts pairs it has not seen better
LENSES = (AUTO, PLUMB_BOB, EQUIDISTANT)
