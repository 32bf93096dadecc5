"""Names of the matching methods and efforts, apart from the matchers: help need not wait for a compiler."""

from __future__ import annotations

METHODS = ("graph_cut", "kz2")
EFFORTS = ("navigation", "balanced", "quality")  #: of graph_cut
