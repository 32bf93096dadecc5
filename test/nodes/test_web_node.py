"""The page of `web_node`: asked as a browser and as BlueOS's helper ask."""

from __future__ import annotations

import json
import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from helpers.ros_bench import Bench, color, own_domain, texture
from sensor_msgs.msg import Image
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.nodes.web_node import WebNode
from uw_recon_ros.nodes.web_server import PICTURES, Seen, as_jpeg, page, serve

ROOT = Path(__file__).parents[2]
SECOND = 1_000_000_000


@pytest.fixture
def seen() -> Seen:
    return Seen()


@pytest.fixture
def address(seen: Seen) -> Iterator[str]:
    server = serve(seen, "127.0.0.1", 0)
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def ask(url: str, **options: Any) -> tuple[int, str, bytes]:
    """Status, type and content of an answer."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, **options), timeout=60) as answer:
            return answer.status, answer.headers["Content-Type"], answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers["Content-Type"], error.read()


def test_blueos_finds_the_page(address: str) -> None:
    """As its helper does: the page answers 200 with a title, /register_service with what `ServiceMetadata` demands."""
    status, kind, content = ask(f"{address}/")
    assert (status, kind) == (200, "text/html; charset=utf-8")
    assert b"<title>Underwater stereo</title>" in content
    status, kind, content = ask(f"{address}/register_service")
    told = json.loads(content)
    assert (status, kind) == (200, "application/json")
    for field in ("name", "description", "icon", "company", "version", "webpage", "api"):
        assert isinstance(told[field], str), field
    assert told["icon"].startswith("mdi-")
    assert told["works_in_relative_paths"] is True


def test_the_page_asks_by_relative_paths_under_a_policy() -> None:
    text = page().decode()
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', text)
    for rule in ("default-src 'none'", "img-src data: blob:", "connect-src 'self'", "form-action 'none'"):
        assert rule in policy.replace("&#39;", "'")
    assert "unsafe-inline" not in policy
    assert not re.search(r"""(src|href)="(https?:)?/""", text)
    assert re.findall(r'fetch\([`"](\w+)', text) == ["state", "picture"]


def test_nothing_else_is_served(address: str) -> None:
    for path in ("/../setup.py", "/picture/../state", "/picture/", "/picture/x", "/etc/passwd", "/%2e%2e/", "/state/x"):
        assert ask(address + path)[0] == 404, path
    for method in ("POST", "PUT", "DELETE"):
        assert ask(f"{address}/state", method=method, data=b"x")[0] == 501


def test_the_state_is_what_diagnostics_say_the_worst_first(seen: Seen, address: str) -> None:
    seen.status("/a_node", 0, "working", {"done [Hz]": "2.0"})
    seen.status("/b_node", 2, "<script>alert(1)</script>" + "x" * 10_000, {str(n): "v" * 9999 for n in range(999)})
    told = json.loads(ask(f"{address}/state")[2])
    assert [node["name"] for node in told["nodes"]] == ["/b_node", "/a_node"]
    assert len(ask(f"{address}/state")[2]) < 40_000
    for number in range(1000):  # whoever floods the topic
        seen.status(f"/{number}", 0, "", {})
    assert len(json.loads(ask(f"{address}/state")[2])["nodes"]) <= 40


def test_pictures_are_small_jpegs_of_what_was_heard(seen: Seen, address: str) -> None:
    assert ask(f"{address}/picture/left")[0] == 503
    image = cv2.GaussianBlur(texture(600, 1200, 3), (0, 0), 6)
    seen.picture("left", color(image, SECOND))
    status, kind, content = ask(f"{address}/picture/left?7")
    assert (status, kind) == (200, "image/jpeg")
    shown = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert shown.shape == (400, 800, 3)
    expected = cv2.resize(image[..., ::-1], (800, 400), interpolation=cv2.INTER_AREA)
    assert np.abs(shown.astype(float) - expected).mean() < 6
    seen.picture("left", Image(height=3, width=3, encoding="nonsense", step=3))
    assert ask(f"{address}/picture/left")[0] == 500


def test_a_disparity_map_is_shown_in_colours_invalid_ones_gray() -> None:
    values = np.tile(np.linspace(1, 60, 64, dtype=np.float32), (48, 1))
    values[:10] = np.nan
    message = DisparityImage()
    message.image = Image(height=48, width=64, encoding="32FC1", step=256)
    message.image.data.frombytes(values.tobytes())
    shown = cv2.imdecode(np.frombuffer(as_jpeg("disparity", message), np.uint8), cv2.IMREAD_COLOR).astype(float)
    assert np.abs(shown[:6] - 40).max() < 12
    assert shown[30, 60].sum() > shown[30, 3].sum()  # near ones are brighter
    message.image.data = message.image.data[:0]
    message.image.data.frombytes(np.full((48, 64), np.nan, np.float32).tobytes())
    assert as_jpeg("disparity", message)


def test_topics_are_listened_to_while_a_browser_asks() -> None:
    bench, seen = Bench(own_domain()), Seen()
    try:
        bench.start(lambda **options: WebNode(seen, context=options["context"]))
        camera = bench.talk(Image, PICTURES["left"])
        voice = bench.talk(DiagnosticArray, "/diagnostics")
        bench.connected(voice)
        bench.spin_for(0.6)
        assert camera.get_subscription_count() == 0
        assert seen.ask("left") is None
        bench.connected(camera)
        camera.publish(color(texture(48, 64), SECOND))
        bench.spin_until(lambda: seen.ask("left"), "the picture")
        status = DiagnosticStatus(level=DiagnosticStatus.WARN, name="/preprocess_node", message="slow")
        status.values = [KeyValue(key="done [Hz]", value="1.5")]
        voice.publish(DiagnosticArray(status=[status]))
        bench.spin_until(lambda: seen.state()["nodes"], "the state")
        (node,) = seen.state()["nodes"]
        assert (node["name"], node["level"], node["values"]) == ("/preprocess_node", 1, {"done [Hz]": "1.5"})
        bench.spin_until(lambda: camera.get_subscription_count() == 0, "nobody asks any more")
    finally:
        bench.close()


def test_a_port_that_is_taken_is_told_in_one_line(address: str) -> None:
    import subprocess
    import sys

    port = address.rpartition(":")[2]
    done = subprocess.run(
        [sys.executable, "-m", "uw_recon_ros.nodes.web_node", "--address", "127.0.0.1", "--port", port],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert f"expected ones that are free, got 127.0.0.1:{port}" in line
