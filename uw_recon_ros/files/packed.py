"""Dataclasses and arrays as bytes and back, for a process that must not run what it reads.

An ``.npz`` file (no pickles in it): the arrays by number, and one JSON text that says what lies where. Only the classes
that the caller names are made.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = list[NDArray[Any]]


def pack(value: Any) -> bytes:
    """Turn dataclasses, dicts, lists, tuples, arrays, numbers, texts and None, nested, into bytes.

    Raises
    ------
    TypeError
        Anything else is in it.
    """
    arrays: Arrays = []
    text = json.dumps(_plain(value, arrays))
    stream = BytesIO()
    named: dict[str, Any] = {f"array_{i}": array for i, array in enumerate(arrays)}
    np.savez(stream, text=np.array(text), **named)
    return stream.getvalue()


def unpack(data: bytes, classes: Iterable[type]) -> Any:
    """Read what `pack` wrote.

    Parameters
    ----------
    data : bytes
    classes : iterable of type
        The dataclasses that may be in it.

    Raises
    ------
    ValueError, KeyError
        It is damaged, or names a class that is not expected.
    """
    with np.load(BytesIO(data), allow_pickle=False) as kept:
        count = len(kept.files) - 1
        arrays = [kept[f"array_{i}"] for i in range(count)]
        document = json.loads(str(kept["text"]))
    return _restored(document, arrays, {cls.__name__: cls for cls in classes})


def _plain(value: Any, arrays: Arrays) -> Any:
    """JSON of a value; whatever JSON does not tell apart is an object with one key."""
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _plain(getattr(value, f.name), arrays) for f in dataclasses.fields(value) if f.init}
        return {"class": [type(value).__name__, fields]}
    if isinstance(value, dict):
        return {"dict": [[_plain(key, arrays), _plain(item, arrays)] for key, item in value.items()]}
    if isinstance(value, tuple):
        return {"tuple": [_plain(item, arrays) for item in value]}
    if isinstance(value, list):
        return [_plain(item, arrays) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"pack: expected dataclasses, collections, arrays, numbers and texts, got {type(value).__name__}")


def _restored(value: Any, arrays: Arrays, classes: dict[str, type]) -> Any:
    if isinstance(value, list):
        return [_restored(item, arrays, classes) for item in value]
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    if kind == "array":
        return arrays[content]
    if kind == "tuple":
        return tuple(_restored(item, arrays, classes) for item in content)
    if kind == "dict":
        return {_restored(k, arrays, classes): _restored(v, arrays, classes) for k, v in content}
    name, fields = content
    return classes[name](**{key: _restored(item, arrays, classes) for key, item in fields.items()})
