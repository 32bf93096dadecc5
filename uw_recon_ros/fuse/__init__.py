"""Many depth maps, one surface: a truncated signed distance weighted by sigma, in blocks, tile by tile."""
