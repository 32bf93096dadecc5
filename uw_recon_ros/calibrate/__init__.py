"""From pictures of a board to the calibration of a rig, and to what that calibration is worth."""
