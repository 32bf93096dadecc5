"""Names of the matching methods and efforts, apart from the matchers: help need not wait for a compiler."""

from __future__ import annotations

METHODS = ("graph_cut", "kz2")
EFFORTS = ("navigation", "balanced", "quality")  #: of graph_cut
NETWORK_VALUES = ("0..1", "0..255", "-1..1", "imagenet")  #: what a stereo network wants gray levels to be
