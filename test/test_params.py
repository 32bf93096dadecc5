"""A parameter is declared once; everything else follows from the declaration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from uw_recon_ros.params import Params, param, read_parameter_file, unknown_names


@dataclass(frozen=True)
class Boundless(Params):
    """A number without limits."""

    number: float = param(0.0, "Any number.")


@dataclass(frozen=True)
class Example(Params):
    """An example."""

    cutoff: float = param(0.5, "Where it cuts.", unit="px", low=0.0, high=1.0)
    count: int = param(3, "How many.", low=1)
    mode: str = param("fast", "How.", choices=("fast", "slow"))
    on: bool = param(True, "Whether.")


def test_integers_pass_for_floats_and_nothing_else_does() -> None:
    assert Example(cutoff=1).cutoff == 1.0
    assert isinstance(Example(cutoff=1).cutoff, float)
    for wrong in ({"count": 1.0}, {"count": True}, {"on": 1}, {"mode": 3}, {"cutoff": "0.5"}, {"cutoff": True}):
        with pytest.raises(TypeError, match=f"{next(iter(wrong))}: expected"):
            Example(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "wrong", [{"cutoff": 1.1}, {"cutoff": -0.1}, {"cutoff": float("nan")}, {"count": 0}, {"mode": "x"}]
)
def test_values_outside_are_refused_by_name(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(wrong))}: expected .*got"):
        Example(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [float("inf"), -float("inf"), float("nan")])
def test_a_number_without_limits_is_still_finite(wrong: float) -> None:
    assert Boundless(number=-1e300).number == -1e300
    with pytest.raises(ValueError, match="number: expected a float, got"):
        Boundless(number=wrong)


def test_parameter_file_merges_sections_in_order(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "/**:\n  ros__parameters: {cutoff: 0.1, count: 2}\n"
        "/rov/match_node:\n  ros__parameters: {count: 5}\n"
        "other_node:\n  ros__parameters: {count: 9}\n"
    )
    values = read_parameter_file(path, ["match_node"])
    assert Example.from_mapping(values | {"foreign": 1}) == Example(cutoff=0.1, count=5)
    assert unknown_names([*values, "cutof"], [Example]) == ["cutof"]


@pytest.mark.parametrize("text", ["- 1", "a: 1", "a: {b: 1}", "a: ["])
def test_other_files_are_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(ValueError, match=r"bad\.yaml: expected"):
        read_parameter_file(tmp_path / "bad.yaml", ["x"])
