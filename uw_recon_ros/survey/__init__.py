"""A whole recorded dive, offline: every stereo pair through the stages, resumable, on as many cores as there are."""
