"""The page holds everything, loads nothing, lets no text become markup, and its 3-D view runs in a browser."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.browser import run_in_browser
from helpers.report_results import HEIGHT, WIDTH, depth_map, pair_results, picture, surface

from uw_recon_ros.report.colors import ColorBar
from uw_recon_ros.report.content import Layer, Map, MapLayer, Overlay, Track
from uw_recon_ros.report.embed import map_json, mesh_json, picture_uri, script_safe
from uw_recon_ros.report.numbers import depth_errors, error_rows, matching_rows, measured, percent, time_rows
from uw_recon_ros.report.page import Figure, Section, Summary, render_page, write_page
from uw_recon_ros.report.pair import write_pair_page
from uw_recon_ros.types import DepthMap, DisparityMap

EVIL = "</script><script>alert('x')</script><img src=x onerror=\"alert(1)\">&'"
VOID = {"meta", "img", "input", "br", "link"}


class Reader(HTMLParser):
    """Collects tags and checks that they are balanced."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.texts: list[str] = []
        self.scripts: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        words = data.replace("\xa0", " ")
        (self.scripts if self.open and self.open[-1] == "script" else self.texts).append(words)


def read(html):
    reader = Reader()
    reader.feed(html)
    reader.close()
    assert reader.open == []
    return reader


@pytest.fixture(scope="module")
def html(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "index.html"
    report = {"stages_seconds": {"preprocess": 0.1, "match": 1.25}}
    write_pair_page(path, *pair_results(), report, truth=depth_map().depth + np.float32(0.01), title="A & B <i>")
    return path.read_text(encoding="utf-8")


def test_the_page_is_well_formed_and_holds_what_it_should(html):
    reader = read(html)
    names = [tag for tag, _ in reader.tags]
    assert names.count("h1") == 1
    assert names.count("figure") == 8
    assert names.count("canvas") == 2
    text = " ".join(reader.texts)
    for words in ("0.21 px", "0.8 px", "321", "kz2", "1.350 s", "metric", "10 mm", "the left camera only 8.3 %"):
        assert words in text, words


def test_nothing_is_loaded_from_anywhere(html):
    assert re.findall(r"(?i)\b(?:https?|ftp|wss?|file):", html) == []
    assert re.findall(r"(?i)@import|url\(|\bimport\s*\(|fetch\(|XMLHttpRequest|<link|<iframe|<base", html) == []
    for _, attributes in read(html).tags:
        for name in ("src", "href", "action", "srcset", "poster", "data"):
            assert attributes.get(name, "data:image/").startswith("data:image/")


def digests(kind, html):
    found = re.findall(rf"<{kind}>(.*?)</{kind}>", html, re.S)
    return [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in found]


def test_the_policy_allows_what_the_shell_put_into_the_page_and_no_more(html):
    policy = next(a["content"] for t, a in read(html).tags if t == "meta" and "http-equiv" in a)
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    for kind in ("script", "style"):
        assert re.findall(r"'sha256-([^']+)'", rules.pop(f"{kind}-src")) == digests(kind, html)
    assert rules == {"default-src": "'none'", "img-src": "data:", "base-uri": "'none'", "form-action": "'none'"}
    assert not [tag for tag, attributes in read(html).tags if "style" in attributes], "the policy would stop it"


def test_no_text_becomes_markup():
    figure = Figure(picture(), EVIL, EVIL, over=picture(), labels=(EVIL, EVIL), reasons=[((1, 2, 3), EVIL, 0.5)])
    section = Section(EVIL, EVIL, [figure, replace(figure, over=None)], [(EVIL, EVIL)], (EVIL, EVIL), surface())
    page = render_page(EVIL, Summary(EVIL, [(EVIL, EVIL)], [EVIL]), [section], replace(surface(), frame_id=EVIL))
    reader = read(page)
    assert "alert" not in " ".join(reader.scripts)
    for tag, attributes in reader.tags:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
    assert "".join(reader.texts).count("<script>alert('x')</script>") >= 10


def test_json_cannot_end_its_script():
    text = script_safe(json.dumps({"a": "</script><!--\u2028"}))
    assert "<" not in text
    assert json.loads(text)["a"] == "</script><!--\u2028"


@pytest.mark.parametrize("side", [9, 300])
def test_the_mesh_comes_back_from_its_json(side):
    source = surface(side=side)
    document = json.loads(mesh_json(source))
    assert document["indexBits"] == (16 if side == 9 else 32)

    def array(name, dtype, width):
        return np.frombuffer(base64.b64decode(document[name]), dtype).reshape(-1, width)

    extent = np.array(document["extent"])
    vertices = document["low"] + array("positions", "<u2", 3) / 65535 * extent
    np.testing.assert_allclose(vertices, source.vertices, atol=1e-5 * extent.max())
    np.testing.assert_allclose(array("uv", "<u2", 2) / 65535, source.uv, atol=1e-5)
    np.testing.assert_allclose(array("normals", "i1", 3) / 127, source.normals, atol=0.005)
    assert np.array_equal(array("index", f"<u{document['indexBits'] // 8}", 3), source.faces)
    assert document["metric"] is True


def numbers(text, dtype):
    return np.frombuffer(base64.b64decode(text), dtype)


def test_layers_and_tracks_come_back_from_their_json():
    source = surface()
    values = np.linspace(0, 2, len(source.vertices))
    layer = Layer("Sigma", values, ColorBar(0.0, 1.0, "m", "magma"))
    track = Track(np.arange(6.0).reshape(2, 3), (1, 2, 3), "seen")
    document = json.loads(mesh_json(source, Overlay([layer], [track], upright=True)))
    assert document["turn"] == [1, 1, 1]
    assert json.loads(mesh_json(source))["turn"] == [1, -1, -1]
    shade = numbers(document["layers"][0]["values"], np.uint8) / 255
    np.testing.assert_allclose(shade, values.clip(0, 1), atol=0.002)
    np.testing.assert_array_equal(numbers(document["tracks"][0]["points"], "<f4"), np.arange(6))


def test_a_map_comes_back_from_its_json_with_what_it_does_not_show():
    image = np.zeros((20, 30, 4), np.uint8)
    image[5:, :, :] = (200, 40, 30, 255)
    document = json.loads(map_json(Map([MapLayer("x", image)], 0.5, 10.0, 20.0, "m")))
    assert (document["width"], document["height"], document["pixel"]) == (30, 20, 0.5)
    assert (document["west"], document["north"]) == (10.0, 20.0)
    back = cv2.imdecode(numbers(document["layers"][0].split(",")[1], np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(back[..., 3], image[..., 3])
    assert np.abs(back[8:, :, [2, 1, 0]].astype(int) - image[8:, :, :3]).mean() < 8


def test_tools_are_those_of_what_is_shown():
    values = np.ones(len(surface().vertices))
    overlay = Overlay(
        [Layer(EVIL, values, ColorBar(0, 1, EVIL, "magma", EVIL))], [Track(np.zeros((1, 3)), (1, 2, 3), EVIL)], True
    )
    image = np.full((4, 4, 4), 255, np.uint8)
    shown = Map([MapLayer(EVIL, image, ColorBar(0, 1, EVIL))], 1.0, 0.0, 0.0, "m")
    reader = read(render_page("x", Summary(), [Section("x", surface=surface(), overlay=overlay, map=shown)]))
    assert "alert" not in " ".join(reader.scripts)
    acts = [attributes.get("data-act") for tag, attributes in reader.tags if tag == "button"]
    assert {"mode-4", "track", "larger"} <= set(acts)
    assert "Height" in reader.texts
    plain = read(render_page("x", Summary(), [], surface()))
    assert "track" not in [attributes.get("data-act") for _, attributes in plain.tags]
    assert "Depth" in plain.texts


@pytest.mark.parametrize("lossless", [True, False])
def test_pictures_come_back_from_their_uri(lossless):
    smooth = cv2.GaussianBlur(picture(), (0, 0), 6.0)
    uri = picture_uri(smooth, max_side=1000, lossless=lossless)
    data = np.frombuffer(base64.b64decode(uri.split(",")[1]), np.uint8)
    back = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1].astype(int)
    assert uri.startswith("data:image/png" if lossless else "data:image/jpeg")
    assert np.abs(back - smooth).mean() <= (0 if lossless else 2)


def test_large_pictures_are_shrunk_and_colour_maps_keep_their_colours():
    stripes = np.zeros((10, 2000, 3), np.uint8)
    stripes[:, ::2] = 255
    uri = picture_uri(stripes, max_side=500, lossless=True)
    back = cv2.imdecode(np.frombuffer(base64.b64decode(uri.split(",")[1]), np.uint8), cv2.IMREAD_COLOR)
    assert back.shape[1] == 500
    assert set(np.unique(back)) <= {0, 255}
    with pytest.raises(ValueError, match=r"image: expected \(H, W, 3\) uint8, got \(3, 3\)"):
        picture_uri(np.zeros((3, 3), np.uint8), max_side=9)


def test_a_large_survey_pair_stays_under_ten_megabytes():
    rng = np.random.default_rng(0)
    rough = cv2.GaussianBlur(rng.integers(0, 256, (1080, 1920, 3), dtype=np.uint8), (0, 0), 1.0)
    figures = [Figure(rough, "x", over=rough)] * 2 + [Figure(rough, "x", wide=True)]
    big = replace(surface(side=141), texture=rough)
    assert len(render_page("x", Summary(), [Section("x", "", figures)], big)) < 10_000_000


def test_an_empty_surface_shows_no_view(html):
    empty = replace(surface(), faces=np.zeros((0, 3), np.int32))
    page = render_page("x", Summary(), [Section("x", surface=empty)], empty)
    assert "<canvas" not in page
    assert "WebGL" not in page
    assert "WebGL" in html


def test_unknown_scale_is_said_on_the_page(tmp_path):
    write_pair_page(tmp_path / "i.html", *pair_results(metric=False))
    text = " ".join(read((tmp_path / "i.html").read_text(encoding="utf-8")).texts)
    assert "The scale is not known" in text
    assert "[m]" not in text
    assert "baselines" in text
    assert "a flat scene <b>does</b> not fix F" in text


def test_a_vertical_rig_is_shown_one_above_the_other(tmp_path):
    write_pair_page(tmp_path / "i.html", *pair_results(axis="vertical"))
    assert "share their columns" in (tmp_path / "i.html").read_text(encoding="utf-8")


def test_a_failed_write_leaves_the_old_page(tmp_path, monkeypatch):
    (tmp_path / "i.html").write_text("old")
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        write_page(tmp_path / "i.html", "x", Summary(), [])
    assert [p.name for p in tmp_path.iterdir()] == ["i.html"]
    assert (tmp_path / "i.html").read_text() == "old"


def test_depth_errors_are_counted_where_both_are_known():
    depth = depth_map()
    truth = depth.depth * np.float32(1.03)
    truth[20] = np.inf
    errors = depth_errors(depth, truth)
    assert errors.median_relative == pytest.approx(0.03 / 1.03, rel=1e-3)
    assert errors.bias < 0
    assert (errors.within_2_percent, errors.within_5_percent) == (0.0, 1.0)
    assert errors.density == pytest.approx(1.0)  # the truth is NaN where the estimate is
    nothing = depth_errors(depth, np.full_like(truth, np.nan))
    assert nothing.density == 0
    assert error_rows(nothing, "m")[0] == ("Depth error, median", "unknown")
    with pytest.raises(ValueError, match="truth: expected"):
        depth_errors(depth, truth[:3])


def test_numbers_are_written_with_their_unit():
    assert measured(0.00361, "m") == "3.61 mm"
    assert measured(-0.25, "m") == "-0.25 m"
    assert measured(0.00361, "baselines") == "0.00361 baselines"
    assert measured(float("nan"), "px") == "unknown"
    assert percent(0.1234) == "12.3 %"
    assert time_rows({"a": 1.0, "b": 0.25})[-1] == ("Time, together", "1.250 s")
    assert time_rows({}) == []


def test_the_view_runs_in_a_browser(tmp_path, html):
    page = tmp_path / "index.html"
    page.write_text(html, encoding="utf-8")
    dom = run_in_browser(page, tmp_path, "--dump-dom")
    assert 'data-ready="yes"' in dom  # set when the texture is on the surface
    assert 'class="viewer failed"' not in dom
    assert "The 3-D view cannot be shown" not in re.sub(r"<script.*?</script>", "", dom, flags=re.S)


def test_the_surface_is_seen_in_the_view(tmp_path):
    red = replace(surface(), texture=np.full((HEIGHT, WIDTH, 3), (230, 20, 30), np.uint8))
    page = tmp_path / "index.html"
    write_page(page, "x", Summary(), [], red)
    run_in_browser(page, tmp_path, f"--screenshot={tmp_path / 'shot.png'}")
    shot = cv2.imread(str(tmp_path / "shot.png"))[..., ::-1].astype(int)
    seen = (shot[..., 0] > 200) & (shot[..., 1] < 60) & (shot[..., 2] < 70)
    assert seen.mean() > 0.05


def test_layers_tracks_and_map_are_seen(tmp_path):
    """The layer's brightest colour on the surface, the track over it, the map's picture below."""
    values, low = np.ones(len(surface().vertices)), surface().vertices.min(axis=0)
    overlay = Overlay([Layer("one", values, ColorBar(0, 1, "m", "viridis"))],
                      [Track(np.array([low, surface().vertices.max(axis=0)]), (250, 0, 250), "way")])  # fmt: skip
    red = Map([MapLayer("x", np.full((40, 40, 4), (220, 20, 10, 255), np.uint8))], 0.1, 0.0, 0.0, "m")
    page = tmp_path / "index.html"
    html = render_page("x", Summary(), [Section(surface=surface(), overlay=overlay, map=red)])
    html = re.sub(r"<meta http-equiv[^>]*>", "", html)  # so that the test may press a button
    html = html.replace("</body>", "<script>document.querySelector('.viewer').view.act('mode-4')</script></body>")
    page.write_text(html, encoding="utf-8")
    run_in_browser(page, tmp_path, f"--screenshot={tmp_path / 'shot.png'}", "--window-size=1000,1600")
    shot = cv2.imread(str(tmp_path / "shot.png"))[..., ::-1].astype(int)

    def share(color, near=40):
        return (np.abs(shot - color).max(axis=2) < near).mean()

    assert share((253, 231, 37), 60) > 0.03  # viridis' end
    assert share((250, 0, 250)) > 0.0005
    assert share((220, 20, 10)) > 0.05


def test_what_a_message_does_not_say_has_no_row():
    results = pair_results()
    disparity = next(r for r in results if isinstance(r, DisparityMap))
    depth = next(r for r in results if isinstance(r, DepthMap))
    unknown = dict(matching_rows(replace(disparity, method="", energy=float("nan")), depth))
    known = dict(matching_rows(replace(disparity, method="kz2", energy=5.0), depth))
    assert known.keys() - unknown.keys() == {"Method", "Energy"}
    assert (known["Method"], known["Energy"]) == ("kz2", "5")


def test_narrow_screens_have_rules_of_their_own(html):
    """The tool bar stands above the view, as wide as it; the page is as wide as the screen."""
    assert 'name="viewport" content="width=device-width' in html
    narrow = html[html.index("@media (max-width: 640px)") :]
    above = re.match(r"[^@]*\.viewer canvas \{ inset: (\d+)px 0 0; height: calc\(100% - (\d+)px\)", narrow[1:])
    assert above
    assert above[1] == above[2]
    assert re.match(r"[^@]*\.tools \{ left: 6px; right: 6px;[^}]*max-width: none", narrow[1:])
    assert not [w for w in re.findall(r"[;{] ?(?:min-)?width: (\d+)px", html) if int(w) > 390]
