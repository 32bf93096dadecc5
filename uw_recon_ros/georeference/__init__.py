"""Rasters that know where they lie."""
