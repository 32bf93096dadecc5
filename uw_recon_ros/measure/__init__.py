"""Lengths, heights and areas in one rectified view with its disparity, each with its standard deviation."""
