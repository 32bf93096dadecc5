"""Disparity to depth, clouds and a textured surface (paper sections 2.3 and 3)."""
