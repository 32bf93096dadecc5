"""Files of any calibration form, parsed into nested dicts, lists and numbers; bounded, and nothing in them is run."""

from __future__ import annotations

import io
import json
import re
import tarfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.io import loadmat

from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files import strict_yaml
from uw_recon_ros.files.bounded import expect_file, read_bounded
from uw_recon_ros.files.kinds import HEAD, describe
from uw_recon_ros.findings import Code

LARGEST_BYTES = 2**20
_LARGEST_ARCHIVE = 2**30  # the tarball of a calibration holds its images
_MOST_MEMBERS = 10_000
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NAMED_NUMBERS = re.compile(rf"^([A-Za-z]\w*):\s+((?:{_NUMBER}\s+)*{_NUMBER})\s*$", re.MULTILINE)


@dataclass(frozen=True)
class Document:
    """One file.

    Parameters
    ----------
    name : str
        Its last part.
    kind : str
        How it is written: ``yaml``, ``json``, ``xml``, ``sections``, ``numbers``, ``table``, ``arrays``, ``matlab``.
    values : list
        Its documents, in order; most kinds have one.
    """

    name: str
    kind: str
    values: list[Any] = field(default_factory=list)

    @property
    def first(self) -> dict[str, Any]:
        """The first document where it is a mapping, else an empty one."""
        return self.values[0] if self.values and isinstance(self.values[0], dict) else {}


def read_documents(path: Path) -> list[Document]:
    """Parse a file, or those of a packed folder that can be calibrations.

    Raises
    ------
    CalibrationError
        It cannot be read, or is written in no way that is known.
    """
    expect_file(path, CalibrationError)
    if _head(path).startswith((b"\x1f\x8b", b"BZh", b"\xfd7zXZ")) or tarfile.is_tarfile(path):
        return list(_of_archive(path))
    name = f"{path.parent.name}/{path.name}" if path.name == "sensor.yaml" else path.name  # EuRoC names folders
    return [parse(name, read_bounded(path, LARGEST_BYTES, CalibrationError))]


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(HEAD)


def _of_archive(path: Path) -> Iterator[Document]:
    """The texts of a tarball as ``camera_calibration`` saves it; its images are passed over."""
    if path.stat().st_size > _LARGEST_ARCHIVE:
        raise CalibrationError(f"expected a tarball of at most {_LARGEST_ARCHIVE} bytes")
    try:
        with tarfile.open(path) as archive:
            for _, member in zip(range(_MOST_MEMBERS), archive, strict=False):
                if member.isfile() and Path(member.name).suffix in (".yaml", ".yml", ".txt"):
                    stream = archive.extractfile(member)
                    if stream is not None and member.size <= LARGEST_BYTES:
                        yield _member(Path(member.name).name, stream.read(LARGEST_BYTES))
    except (tarfile.TarError, EOFError, OSError, ValueError) as error:
        raise CalibrationError("expected a tarball as camera_calibration saves it, got a damaged one") from error


def _member(name: str, content: bytes) -> Document:
    try:
        return parse(name, content)
    except CalibrationError as error:
        raise CalibrationError(f"{name} in it: {error}", error.code) from error


def parse(name: str, content: bytes) -> Document:
    """Parse a file's bytes.

    Raises
    ------
    CalibrationError
        They are written in no way that is known, or damaged; the text names the kind.
    """
    if content.startswith(b"PK\3\4"):
        return Document(name, "arrays", [_arrays(content)])
    if content.startswith(b"MATLAB 5.0"):
        return Document(name, "matlab", [_matlab(content)])
    if content.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise CalibrationError("a MATLAB file of version 7.3: save it with save(name, 'var', '-v7')")
    text = _text(content)
    if text.lstrip().startswith("Calibration results\n"):
        raise CalibrationError("a report of kalibr: name the camchain that it wrote beside it (camchain-....yaml)")
    for fits, kind, reader in _TEXTS:
        if fits(text, name):
            return Document(name, kind, reader(text))
    return Document(name, "yaml", _yaml(text))


def _text(content: bytes) -> str:
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise CalibrationError(
            f"expected a calibration file, got {describe(content[:HEAD])}", Code.CALIBRATION_UNKNOWN_FORM
        ) from error


def _arrays(content: bytes) -> dict[str, Any]:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            if sum(entry.file_size for entry in packed.infolist()) > LARGEST_BYTES:
                raise CalibrationError("expected a few matrices in an npz file, got more than 1 MiB")
        with np.load(io.BytesIO(content), allow_pickle=False) as kept:
            return {name: array for name in kept.files if (array := _plain_array(kept, name)) is not None}
    except (ValueError, OSError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise CalibrationError(
            "expected an npz file of plain matrices, got a damaged one or one with objects"
        ) from error


def _plain_array(kept: Any, name: str) -> Any:
    """A matrix of an npz; None where it holds Python's objects (``rvecs`` of a script), which are not opened."""
    try:
        return kept[name]
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        return None


def _matlab(content: bytes) -> dict[str, Any]:
    try:
        stream: Any = io.BytesIO(content)
        return {name: plain(value) for name, value in loadmat(stream, simplify_cells=True).items()}
    except CalibrationError:
        raise
    except Exception as error:  # a parser of strangers' bytes: it raises whatever it meets
        raise CalibrationError("expected a MATLAB file of version 5, got a damaged one") from error


def plain(value: Any) -> Any:
    """MATLAB's nested structs as dicts; a class instance, whose content MATLAB keeps to itself, as None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind in "OV":
        return None
    return value


def _yaml(text: str) -> list[Any]:
    """Plain YAML; OpenCV's first line and its tags, which YAML 1.2 does not allow there, are taken out before."""
    without = re.sub(r"\A%YAML[: ]1\.\d\s*?\n(---\s*?\n)?", "", text)
    without = re.sub(r"!!opencv-[\w-]+|!!python/tuple", "", without)
    try:
        return [document for document in strict_yaml.load_all(without) if document is not None]
    except strict_yaml.YamlError as error:
        raise CalibrationError(f"expected a calibration file: {error}") from error


def _json(text: str) -> list[Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"expected JSON as its first letter says: {' '.join(str(error).split())}") from error
    return [found]


def _xml(text: str) -> list[Any]:
    if "<!" in text.replace("<!--", ""):
        raise CalibrationError("expected plain XML, got a document type or entities")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise CalibrationError(f"expected XML as its first letter says: {error}") from error
    return [{root.tag: {child.tag: _element(child) for child in root}}]


def _element(element: Any) -> Any:
    """Children as a dict; text as what it means in YAML, several words as a list."""
    if len(element):
        return {child.tag: _element(child) for child in element}
    words = [strict_yaml.plain_value(word.rstrip(".") or word) for word in (element.text or "").split()]
    return words[0] if len(words) == 1 and element.tag != "data" else words


def _sections(text: str) -> list[Any]:
    """``[name]`` with ``key=value`` lines (ZED); a key that comes again counts as its last."""
    found: dict[str, dict[str, Any]] = {}
    section = ""
    for line in text.splitlines():
        line = line.split("#")[0].strip()
        if line.startswith("["):
            section = line.strip("[]")
        elif "=" in line:
            key, value = (part.strip() for part in line.split("=", 1))
            found.setdefault(section, {})[key] = strict_yaml.plain_value(value)
    return [found]


def _ost(text: str) -> list[Any]:
    """Cameras of an ``ost.txt``: each begins with ``[image]``, and heads its matrices with words."""
    return [_ost_camera(part) for part in re.split(r"^\[image\]", text, flags=re.MULTILINE)[1:]]


def _ost_camera(text: str) -> dict[str, Any]:
    name = re.search(r"^\[(.*)\]", text, re.MULTILINE)
    found: dict[str, Any] = {"camera_name": name[1] if name else ""}
    for head, body in re.findall(r"^([a-z ]+)\n((?:[-+0-9.eE \t]+(?:\n|\Z))+)", text, re.MULTILINE):
        found[head.strip()] = [float(word) for word in body.split() if re.fullmatch(_NUMBER, word)]
    return found


def _numbers(text: str) -> list[Any]:
    return [{name: [float(word) for word in words.split()] for name, words in _NAMED_NUMBERS.findall(text)}]


def _table(text: str) -> list[Any]:
    return [[line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]]


_TEXTS = (
    (lambda text, _: text.lstrip().startswith("<"), "xml", _xml),
    (lambda text, _: text.startswith("# oST") or "[image]\n" in text, "ost", _ost),
    (lambda text, _: re.search(r"^\[\w+\]\s*$", text, re.MULTILINE) and "=" in text, "sections", _sections),
    (lambda text, name: text.lstrip()[:1] in "{[" and not name.endswith((".yaml", ".yml")), "json", _json),
    (lambda text, _: re.search(r"^P([02]|_rect_0\d):\s+[-+.\d]\S*\s+[-+.\d]", text, re.MULTILINE), "numbers", _numbers),
    (lambda text, name: name in ("cameras.txt", "rigs.txt") or "# Camera list" in text, "table", _table),
)
