"""Names of a package that are loaded when they are asked for (PEP 562): a light import, a short wait for help."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from types import ModuleType
from typing import Any


def on_demand(package: str, names: Mapping[str, Sequence[str]]) -> Callable[[str], object]:
    """Make a package's ``__getattr__``.

    Parameters
    ----------
    package : str
        Its ``__name__``.
    names : mapping of str to sequence of str
        Module of the package -> what it gives.
    """
    places = {name: module for module, given in names.items() for name in given}

    def look_up(name: str) -> object:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{places[name]}"), name)

    return look_up


def make_callable(room: str, door: str) -> None:
    """Let a room be called as the verb that bears its name.

    The front door has the verbs ``match``, ``rectify`` and ``reconstruct``, and Python binds these names to the
    packages as soon as one is imported; so the packages themselves are both.

    Parameters
    ----------
    room : str
        ``__name__`` of the package.
    door : str
        Module that has the verb; loaded at the first call.
    """
    verb = room.rsplit(".", 1)[-1]

    class Room(ModuleType):
        def __call__(self, *args: Any, **options: Any) -> Any:
            return getattr(import_module(door), verb)(*args, **options)

    sys.modules[room].__class__ = Room
