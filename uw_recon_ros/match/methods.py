"""Names of the matching methods, apart from the matchers: a command line's help need not wait for a compiler."""

from __future__ import annotations

METHODS = ("kz2",)
