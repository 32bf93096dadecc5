"""A dive as bag, as side-by-side video and as two videos without sync: the models are one, within the codec's noise."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.filmed_dives import Filming, Made, modelled, write_forms

from uw_recon_ros.simulate.params import CourseParams, SimulateParams

#: Rates that can be rendered in a test: partners are some 35 ms apart, which at 30 Hz is twice the worst case.
FILMING = Filming(
    SimulateParams(width=240, height=180, speed_m_s=0.08, snow_per_m3=0.0), CourseParams(track="line"),
    seconds=12.0, rates=(5.0, 9.99), offset_s=1.37, every=5,
)  # fmt: skip
PARAMS = """/**:
  ros__parameters:
    effort: navigation
    min_disparity: 2
    max_disparity: 40
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("av", reason="videos need the extra 'video'")
    folder = tmp_path_factory.mktemp("filmed")
    write_forms(folder, FILMING)
    return folder


@pytest.fixture(scope="module")
def forms(folder: Path) -> dict[str, Made]:
    return {name: modelled(folder, name, FILMING, PARAMS) for name in ("bag", "sbs", "two")}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sbs", "two"])
def test_a_video_gives_the_model_of_its_bag(forms: dict[str, Made], name: str) -> None:
    """What the codec costs is seen in `sbs`, which has the bag's pairs; two cameras without sync may cost as much."""
    bag, video = forms["bag"], forms[name]
    assert video.pairs >= bag.pairs - 1
    assert bag.median_mm < 6
    assert bag.completeness_percent > 40
    assert video.median_mm < 1.25 * bag.median_mm
    assert video.ate_mm < bag.ate_mm + 1.0  # a thousandth of the way
    assert video.completeness_percent > bag.completeness_percent - 8


@pytest.mark.slow
def test_the_clock_of_the_two_is_found_and_what_it_leaves_is_told(forms: dict[str, Made], folder: Path) -> None:
    """Rates of 5 and 9.99 Hz, slow swell: a tenth of the faster one's interval, and no more than three sigma."""
    note = next(note for note in forms["two"].notes if "right clock ahead" in note)
    found = float(note.split("ahead by ")[1].split(" s")[0])
    sigma = float(note.split("sigma ")[1].split(" s")[0])
    assert found == pytest.approx(FILMING.offset_s, abs=0.01)
    assert abs(found - FILMING.offset_s) < 3 * sigma
    partners = json.loads((folder / "two_out" / "model" / "model.json").read_text())["partners"]
    assert partners["corrected"] == partners["not_of_one_moment"] == forms["two"].pairs
    assert 10 < partners["lag_ms"]["median"] < 51
