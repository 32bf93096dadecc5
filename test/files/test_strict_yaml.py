"""The strict reader of YAML: what it reads agrees with PyYAML, what it refuses is told in one line, at little cost."""

from __future__ import annotations

import json
import random
import resource
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.errors import BagError, CalibrationError
from uw_recon_ros.files import strict_yaml
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.files.strict_yaml import DEEPEST, LARGEST_BYTES, MOST_VALUES, YamlError, load, load_all
from uw_recon_ros.params import read_parameter_file

CAMERA = """\
image_width: 640
image_height: 480
camera_name: left
frame_id: left_optical_frame
camera_matrix: {rows: 3, cols: 3, data: [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 1.0e-2, 0, 0, 0]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix:
  rows: 3
  cols: 4
  data: [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]
"""
RIG = CAMERA + "---\n" + CAMERA.replace("left", "right")
PARAMETERS = "/**:\n  ros__parameters:\n    effort: balanced\n    max_disparity: 64\n    wavelet: yes\n"
METADATA = "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n    - a_0.db3\n  nothing: ~\n"
BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n"
    for before, name in zip("abcdefghijk", "bcdefghijkl", strict=True)
)
REFUSED = {
    BOMB: "line 5: expected at most 100000 values",
    "[" * 5000: "line 1: expected at most 32 collections within each other",
    "a: &a [*a]": "line 1: expected an alias of something whole, got *'a'",
    "&a b: 1\nc: *d": "line 2: expected an alias of something whole",
    "a: !!bool foo": "line 1: expected plain values without tags, got '!!bool'",
    'a: 1\nb: !!int ""': "line 2: expected plain values without tags",
    "!!python/object/apply:os.system [ls]": "line 1: expected plain values without tags",
    "a: 1\na: 2": "line 2: expected each key once, got 'a' again",
    "base: &b {x: 1}\nc: {<<: *b}": "line 2: expected a key of plain text, got '<<'",
    "? [a]\n: b": "line 1: expected a key of plain text, got a collection",
    "a: 99999999999999999999": "line 1: expected an integer of 64 bits",
    "a: [1\nb: 2": "line 2, column 2: invalid YAML",
    'a: "\\U00FFFFFF"': "invalid YAML",
    "a: \x00": "expected printable text, got character 3",
    "a: 1\n---\nb: 1": "expected one YAML document, got 2",
}


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_what_is_refused_is_told_in_one_line(text: str) -> None:
    with pytest.raises(YamlError) as told:
        load(text)
    assert REFUSED[text] in str(told.value)
    assert "\n" not in str(told.value)
    assert len(str(told.value)) < 200


def test_bytes_and_sizes() -> None:
    with pytest.raises(YamlError, match="expected text in UTF-8, got byte 3 that is none"):
        load(b"a: \xff")
    with pytest.raises(YamlError, match=f"expected at most {LARGEST_BYTES} bytes of YAML, got {LARGEST_BYTES + 1}"):
        load("x" * (LARGEST_BYTES + 1))


def test_the_bounds_are_where_they_are_said_to_be() -> None:
    assert load("[" * DEEPEST + "]" * DEEPEST)
    with pytest.raises(YamlError):
        load("[" * (DEEPEST + 1) + "]" * (DEEPEST + 1))
    deep = "{k: " * 20 + "1" + "}" * 20
    with pytest.raises(YamlError, match="within each other"):
        load(f"a: &a {deep}\nb: {'[' * 15}*a{']' * 15}")
    thousand = "[" + ",".join("1" * 999) + "]"
    most = MOST_VALUES // 1000 - 2
    assert len(load(f"- &a {thousand}\n" + "- *a\n" * most)) == most + 1
    with pytest.raises(YamlError, match="aliases counted"):
        load(f"- &a {thousand}\n" + "- *a\n" * (most + 1))


def test_plain_scalars() -> None:
    text = (
        "[1, -2, 0x1F, 1.5, .5, 5., 1e5, -1.0e-3, yes, OFF, ~, '', 007, 1_000, 12:30, 2001-99-99, 'yes', .inf, \"1\"]"
    )
    infinite = float("inf")
    told = [1, -2, 31, 1.5, 0.5, 5.0, 1e5, -1e-3, True, False, None, "", "007", "1_000", "12:30", "2001-99-99", "yes"]
    assert load(text) == [*told, infinite, "1"]
    assert load("{1: a, yes: b}") == {"1": "a", "yes": "b"}
    assert load_all("") == []
    assert load("") is None


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=["C"]), max_size=12),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.text(st.characters(min_codepoint=97, max_codepoint=122), min_size=1), inner, max_size=4),
    max_leaves=12,
)  # fmt: skip


@settings(derandomize=True, max_examples=150, deadline=None)
@given(PLAIN, st.booleans())
def test_it_reads_what_pyyaml_writes(value: Any, flow: bool) -> None:
    assert load(yaml.safe_dump(value, default_flow_style=flow, allow_unicode=True)) == value


@settings(derandomize=True, max_examples=300, deadline=None)
@given(st.text(st.sampled_from("ab1.:-[]{}&*!|>'\"#%@?,~ \n\t\\x0e"), max_size=60))
def test_any_text_is_read_or_refused(text: str) -> None:
    with suppress(YamlError):
        load_all(text)


def mutants(text: str, count: int, seed: int) -> list[bytes]:
    """Bytes flipped, lines lost, doubled or moved, and values that no one means, put in at random places."""
    dice = random.Random(seed)
    strange = (
        "!!bool foo", '!!int ""', ".inf", "-.INF", ".nan", "[" * 300, "&a [*a]", "{}", "[]", "~", "'", "|",
        "2001-99-99", "1e999", "9" * 400, "!!binary x", "\x85", "true", "0x", "- - - -", "? ?", "%YAML 9", "<<", "-1",
    )  # fmt: skip
    found = []
    for _ in range(count):
        lines = text.split("\n")
        for _ in range(dice.choice([1, 1, 2, 4])):
            place = dice.randrange(len(lines))
            kind = dice.randrange(5)
            if kind == 0:
                lines[place] = lines[place].split(":")[0] + ": " + dice.choice(strange)
            elif kind == 1:
                lines.insert(place, lines[dice.randrange(len(lines))])
            elif kind == 2 and len(lines) > 1:
                del lines[place]
            elif kind == 3:
                parts = lines[place].split(" ")
                parts[dice.randrange(len(parts))] = dice.choice(strange)
                lines[place] = " ".join(parts)
        data = bytearray("\n".join(lines).encode())
        if dice.random() < 0.4 and data:
            data[dice.randrange(len(data))] = dice.randrange(256)
        found.append(bytes(data))
    return found


@pytest.mark.parametrize("seed", range(3))
def test_mutated_files_are_read_or_refused_in_one_line(tmp_path: Path, seed: int) -> None:
    """750 of them; on the version before, 15 of 750 ended in a traceback."""
    file = tmp_path / "x.yaml"
    told = []
    for text, read in ((RIG, read_calibration), (PARAMETERS, _parameters), (METADATA, strict_yaml.read)):
        for data in mutants(text, 84, seed):
            file.write_bytes(data)
            try:
                read(file)
            except (CalibrationError, BagError, YamlError, ValueError) as error:
                told.append((type(error), str(error)))
    assert len(told) > 60
    assert all("\n" not in text and len(text) < 700 and kind is not UnicodeDecodeError for kind, text in told)


def _parameters(path: Path) -> dict[str, Any]:
    return read_parameter_file(path, ["disparity"])


@pytest.mark.parametrize(
    ("spoiled", "told"),
    [
        ("image_width: .inf", "image_width: expected a whole number, got float 'inf'"),
        ("image_width: !!bool foo", "line 1: expected plain values without tags"),
        ("image_width: 640.0", "image_width: expected a whole number, got float '640.0'"),
        ("image_width: true", "image_width: expected a whole number, got bool 'True'"),
        ("other: 3", "image_width: expected a whole number, got nothing"),
    ],
)
def test_a_calibration_that_makes_no_sense(tmp_path: Path, spoiled: str, told: str) -> None:
    (tmp_path / "rig.yaml").write_text(RIG.replace("image_width: 640", spoiled, 1))
    with pytest.raises(CalibrationError) as error:
        read_calibration(tmp_path / "rig.yaml")
    assert told in str(error.value)
    assert "rig.yaml" in str(error.value)
    (tmp_path / "rig.yaml").write_text(RIG)
    assert read_calibration(tmp_path / "rig.yaml").left.width == 640


@pytest.mark.parametrize(
    ("name", "told"),
    [("none.yaml", "there is no such file or folder"), ("nothing/inside", "there is no such file or folder")],
)
def test_no_file(tmp_path: Path, name: str, told: str) -> None:
    with pytest.raises(CalibrationError, match=told):
        read_calibration(tmp_path / name)
    with pytest.raises(ValueError, match=told):
        _parameters(tmp_path / name)


CHILD = """
import json, resource, sys
from uw_recon_ros.files.strict_yaml import YamlError, load_all
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
told = []
for name in sys.argv[1:]:
    try:
        load_all(open(name, "rb").read())
        told.append("read")
    except YamlError as error:
        told.append(str(error))
print(json.dumps([told, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before]))
"""


def test_bombs_cost_little(tmp_path: Path) -> None:
    """Memory of a process that reads them all; the version before took 2.6 GB."""
    bombs = [
        BOMB.encode(),
        b"[" * 2**20,
        b"&a " * 300_000,
        b"{a: " * 200_000,
        b"- " * 500_000,
        b'"' + b"\\x61" * 250_000,
    ]
    for i, data in enumerate(bombs):
        (tmp_path / f"{i}.yaml").write_bytes(data)
    names = [str(tmp_path / f"{i}.yaml") for i in range(len(bombs))]
    room = 2**30
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *names], capture_output=True, text=True, check=False, timeout=300,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (room, room)), env={"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    told, grown_kb = json.loads(done.stdout)
    assert "read" not in told
    assert grown_kb < 64 * 1024
