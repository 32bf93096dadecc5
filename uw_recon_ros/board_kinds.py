"""Names of the kinds of boards, apart from their points: help need not wait for numpy."""

from __future__ import annotations

CHECKERBOARD, CHARUCO, APRILGRID = "checkerboard", "charuco", "aprilgrid"
CIRCLES, ASYMMETRIC = "circles", "asymmetric-circles"
KINDS = (CHECKERBOARD, CHARUCO, APRILGRID, CIRCLES, ASYMMETRIC)
