"""A model while the dive goes on: submaps of a few metres, fused as they come, moved by loops."""
