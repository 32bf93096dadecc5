"""The one reader of YAML that others wrote: calibrations, parameter files, metadata of bags.

YAML's events are turned into plain Python values here, without PyYAML's constructors: nothing recursive, nothing that a
few bytes can make large. Read are mappings with keys of text, sequences, and plain scalars (YAML 1.2's core schema, and
YAML 1.1's yes/no/on/off); refused are tags, merge keys, keys given twice, and whatever goes over the bounds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from uw_recon_ros.errors import ReconError
from uw_recon_ros.files.bounded import read_bounded
from uw_recon_ros.findings import Code

#: Bytes of a document, nested collections, and values in all, counting what aliases repeat.
LARGEST_BYTES = 2**20
DEEPEST = 32
MOST_VALUES = 100_000
_SHOWN = 40

_CONSTANTS: dict[str, bool | float | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **{form(word): True for word in ("true", "yes", "on") for form in (str.lower, str.title, str.upper)},
    **{form(word): False for word in ("false", "no", "off") for form in (str.lower, str.title, str.upper)},
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
    **{sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")},
}
_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")


class YamlError(ReconError):
    """A document that is not read: one line, with the line's number."""

    default_code = Code.YAML


@dataclass
class _Open:
    """A collection under way, or the stream of documents (`value` is then their list)."""

    value: list[Any] | dict[str, Any]
    anchor: str | None = None
    key: str | None = None
    size: int = 1
    depth: int = 0  #: nested collections within


@dataclass
class _Builder:
    """Values out of events."""

    documents: list[Any] = field(default_factory=list)
    anchors: dict[str, tuple[Any, int, int]] = field(default_factory=dict)
    values: int = 0

    def __post_init__(self) -> None:
        self.stack = [_Open(self.documents)]

    def take(self, event: Any) -> None:
        """Go one event on."""
        if isinstance(event, yaml.DocumentStartEvent):
            self.anchors = {}
        elif isinstance(event, yaml.AliasEvent):
            self._repeat(event.anchor)
        elif isinstance(event, yaml.ScalarEvent):
            self._scalar(event)
        elif isinstance(event, yaml.CollectionStartEvent):
            self._open(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            done = self.stack.pop()
            self._add(done.value, done.anchor, done.size, done.depth + 1)

    def _repeat(self, anchor: str | None) -> None:
        if anchor is None or anchor not in self.anchors:
            raise YamlError(f"expected an alias of something whole, got *{_short(anchor)}")
        value, size, depth = self.anchors[anchor]
        self._count(size)
        self._nest(depth)
        self._add(value, None, size, depth)

    def _scalar(self, event: Any) -> None:
        _expect_no_tag(event.tag)
        self._count(1)
        wants_key = isinstance(self.stack[-1].value, dict) and self.stack[-1].key is None
        plain = event.implicit[0] and not wants_key
        self._add(plain_value(event.value) if plain else event.value, event.anchor, 1, 0)

    def _open(self, event: Any) -> None:
        _expect_no_tag(event.tag)
        self._count(1)
        self._nest(1)
        if isinstance(self.stack[-1].value, dict) and self.stack[-1].key is None:
            raise YamlError("expected a key of plain text, got a collection")
        self.stack.append(_Open({} if isinstance(event, yaml.MappingStartEvent) else [], event.anchor))

    def _count(self, more: int) -> None:
        self.values += more
        if self.values > MOST_VALUES:
            raise YamlError(f"expected at most {MOST_VALUES} values, aliases counted as what they repeat, got more")

    def _nest(self, more: int) -> None:
        if len(self.stack) - 1 + more > DEEPEST:
            raise YamlError(f"expected at most {DEEPEST} collections within each other, got more")

    def _add(self, value: Any, anchor: str | None, size: int, depth: int) -> None:
        if anchor is not None:
            self.anchors[anchor] = value, size, depth
        parent = self.stack[-1]
        parent.size += size
        parent.depth = max(parent.depth, depth)
        if isinstance(parent.value, list):
            parent.value.append(value)
        elif parent.key is None:
            parent.key = _checked_key(value, parent.value)
        else:
            parent.value[parent.key] = value
            parent.key = None


def _checked_key(key: Any, taken: dict[str, Any]) -> str:
    if not isinstance(key, str) or key == "<<":
        raise YamlError(f"expected a key of plain text, got {_short(key)}")
    if key in taken:
        raise YamlError(f"expected each key once, got {_short(key)} again")
    return key


def _expect_no_tag(tag: str | None) -> None:
    if tag is not None:
        raise YamlError(f"expected plain values without tags, got {_short(tag.replace('tag:yaml.org,2002:', '!!'))}")


def _short(text: Any) -> str:
    shown = str(text)
    return ascii(shown) if len(shown) <= _SHOWN else f"{shown[:_SHOWN]!a}..."


def plain_value(text: str) -> str | int | float | bool | None:
    """What an unquoted scalar means; what is no number and no constant is text, and so is ``007``.

    Raises
    ------
    YamlError
        An integer of more than 64 bits.
    """
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if _INTEGER.fullmatch(text):
        if len(text) > 20 or not -(2**63) <= (number := int(text, 0)) < 2**64:
            raise YamlError(f"expected an integer of 64 bits, got {_short(text)}")
        return number
    if _FLOAT.fullmatch(text) and not _LEADING_ZERO.fullmatch(text):
        return float(text)
    return text


def _events(text: str) -> Iterator[Any]:
    yield from yaml.parse(text, Loader=yaml.SafeLoader)


def load_all(content: str | bytes) -> list[Any]:
    """Read all documents of a text.

    Parameters
    ----------
    content : str or bytes
        Bytes are UTF-8.

    Returns
    -------
    list
        Of nested dict (keys are text), list, str, int, float, bool and None. Aliases share one object.

    Raises
    ------
    YamlError
        In one line, with the number of the line in the text.
    """
    if len(content) > LARGEST_BYTES:
        raise YamlError(f"expected at most {LARGEST_BYTES} bytes of YAML, got {len(content)}")
    line, builder = 0, _Builder()
    try:
        text = content.decode("utf-8") if isinstance(content, bytes) else content
        for event in _events(text):
            line = event.start_mark.line
            builder.take(event)
    except UnicodeDecodeError as error:
        raise YamlError(f"expected text in UTF-8, got byte {error.start} that is none") from error
    except YamlError as error:
        raise YamlError(f"line {line + 1}: {error}") from error
    except yaml.reader.ReaderError as error:
        raise YamlError(f"expected printable text, got character {error.position} that is none") from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}" if mark else f"line {line + 1}"
        raise YamlError(f"{place}: invalid YAML: check brackets, quotes, colons and indentation there") from error
    except Exception as error:  # PyYAML's scanner has failures of its own, e.g. chr() of an escape out of range
        raise YamlError(f"line {line + 1}: invalid YAML: something there cannot be read") from error
    return builder.documents


def load(content: str | bytes) -> Any:
    """Read a text of one document; None when it is empty. See `load_all`."""
    documents = load_all(content)
    if len(documents) > 1:
        raise YamlError(f"expected one YAML document, got {len(documents)}")
    return documents[0] if documents else None


def read_all(path: str | Path) -> list[Any]:
    """Read all documents of a file. The error does not name it: the caller knows what it is for.

    Raises
    ------
    YamlError
        Also for a file that is missing, too large or not readable.
    """
    return load_all(read_bounded(path, LARGEST_BYTES, YamlError))


def read(path: str | Path) -> Any:
    """Read a file of one document. See `read_all`."""
    return load(read_bounded(path, LARGEST_BYTES, YamlError))
