"""The page of `web_node`: a small HTTP server, read only, of what was heard last. Knows no ROS but its messages."""

from __future__ import annotations

import json
import threading
import time
from functools import cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import uw_recon_ros
from uw_recon_ros.errors import ReconError
from uw_recon_ros.report.shell import render
from uw_recon_ros.ros.messages import float_image_from_message, image_from_message
from uw_recon_ros.types import ByteImage

#: What the page shows, and the topic of each.
PICTURES = {
    "left": "left/image_enhanced",
    "right": "right/image_enhanced",
    "disparity": "disparity",
}
_CAPTIONS = {"left": "Left camera, enhanced", "right": "Right camera, enhanced", "disparity": "Disparity, bright: near"}
_ASKED_S = 5.0  # a picture is wanted so long after a browser asked for it
_WIDTH = 800  # px of a picture on the page
_MOST_NODES, _MOST_VALUES, _LONGEST = 40, 60, 300
#: As BlueOS asks for it: its helper's `ServiceMetadata`.
SERVICE = {
    "name": "Underwater stereo",
    "description": "State and pictures of the stereo reconstruction (uw_recon_ros)",
    "icon": "mdi-rotate-3d",
    "company": "uw_recon_ros",
    "version": uw_recon_ros.__version__,
    "webpage": "",
    "api": "",
    "works_in_relative_paths": True,
}


class Seen:
    """What was heard last, and what the page asked for. Safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._statuses: dict[str, tuple[float, dict[str, Any]]] = {}
        self._pictures: dict[str, tuple[float, Any]] = {}
        self._asked: dict[str, float] = {}

    def status(self, name: str, level: int, message: str, values: dict[str, str]) -> None:
        """Note what a node says of itself."""
        kept = {key[:_LONGEST]: value[:_LONGEST] for key, value in list(values.items())[:_MOST_VALUES]}
        told = {"name": name[:_LONGEST], "level": level, "message": message[:_LONGEST], "values": kept}
        with self._lock:
            if name in self._statuses or len(self._statuses) < _MOST_NODES:
                self._statuses[name] = time.monotonic(), told

    def picture(self, name: str, message: Any) -> None:
        """Note a picture's newest message; it is looked at when a browser asks."""
        with self._lock:
            self._pictures[name] = time.monotonic(), message

    def asked(self, name: str) -> bool:
        """Whether a browser wants a picture."""
        with self._lock:
            return time.monotonic() - self._asked.get(name, -_ASKED_S) < _ASKED_S

    def ask(self, name: str) -> Any | None:
        """The newest message of a picture, None where none has come yet; it is wanted from now on."""
        with self._lock:
            self._asked[name] = time.monotonic()
            found = self._pictures.get(name)
            return found[1] if found and time.monotonic() - found[0] < 60.0 else None

    def state(self) -> dict[str, Any]:
        """For JSON: each node's status with its age, s, the worst first, and how old pictures are."""
        now = time.monotonic()
        with self._lock:
            nodes = [{**told, "age_s": round(now - since, 1)} for since, told in self._statuses.values()]
            pictures = {name: round(now - since, 1) for name, (since, _) in self._pictures.items()}
        return {"nodes": sorted(nodes, key=lambda node: (-node["level"], node["name"])), "pictures": pictures}


def as_jpeg(name: str, message: Any) -> bytes:
    """A picture for the page.

    Raises
    ------
    ReconError
        The message cannot be read.
    """
    image = _colored(float_image_from_message(message.image)) if name == "disparity" else _as_bgr(message)
    scale = min(1.0, _WIDTH / image.shape[1])
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    return bytes(cv2.imencode(".jpg", cv2.resize(image, size, interpolation=cv2.INTER_AREA))[1])


def _as_bgr(message: Any) -> ByteImage:
    raw = image_from_message(message)
    eight = np.asarray(raw if raw.dtype == np.uint8 else raw >> 8, np.uint8)
    return np.ascontiguousarray(eight[..., ::-1]) if eight.ndim == 3 else eight


def _colored(disparity: NDArray[np.float32]) -> ByteImage:
    """BGR of a disparity map, from its 2nd to its 98th percentile; invalid pixels dark gray."""
    valid = np.isfinite(disparity)
    low, high = np.percentile(disparity[valid], (2, 98)) if valid.any() else (0.0, 1.0)
    scaled = np.clip((np.where(valid, disparity, low) - low) / max(high - low, 1e-6), 0, 1)
    colored = cv2.applyColorMap(np.asarray(255 * scaled, np.uint8), cv2.COLORMAP_VIRIDIS)
    colored[~valid] = 40
    return np.asarray(colored, np.uint8)


@cache
def page() -> bytes:
    """The page itself; what it shows it asks for."""
    summary = {"lead": "State and pictures of the running nodes.", "facts": [], "warnings": [], "alarms": []}
    return render(
        "report/live.html", title="Underwater stereo", summary=summary, captions=_CAPTIONS, served=True,
        scripts=("report/page.js", "report/live.js"),
    ).encode()  # fmt: skip


class _Handler(BaseHTTPRequestHandler):
    """Answers GET; everything else is refused by the base class."""

    protocol_version = "HTTP/1.1"
    timeout = 20
    seen: Seen

    def do_GET(self) -> None:
        path = self.path.partition("?")[0].strip("/")
        if path == "":
            self._send("text/html; charset=utf-8", page())
        elif path == "state":
            self._send("application/json", json.dumps(self.seen.state()).encode())
        elif path == "register_service":
            self._send("application/json", json.dumps(SERVICE).encode())
        elif path.startswith("picture/") and path.removeprefix("picture/") in PICTURES:
            self._picture(path.removeprefix("picture/"))
        else:
            self._send("text/plain", b"expected /, /state, /picture/NAME or /register_service\n", HTTPStatus.NOT_FOUND)

    def _picture(self, name: str) -> None:
        message = self.seen.ask(name)
        if message is None:
            self._send("text/plain", b"no picture yet\n", HTTPStatus.SERVICE_UNAVAILABLE)
            return
        try:
            self._send("image/jpeg", as_jpeg(name, message))
        except ReconError as error:
            self._send("text/plain", f"{error}\n".encode(), HTTPStatus.INTERNAL_SERVER_ERROR)

    def _send(self, kind: str, content: bytes, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        for header, value in (
            ("Content-Type", kind), ("Content-Length", str(len(content))), ("Cache-Control", "no-store"),
            ("X-Content-Type-Options", "nosniff"), ("Referrer-Policy", "no-referrer"),
        ):  # fmt: skip
            self.send_header(header, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: Any) -> None:
        """Say nothing: a browser asks each second."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_: Any) -> None:
        """Say nothing: a browser that went away."""


def serve(seen: Seen, address: str, port: int) -> ThreadingHTTPServer:
    """Serve in threads of its own; `shutdown` ends it. Raises `OSError` where the address is taken."""
    server = _Server((address, port), type("Handler", (_Handler,), {"seen": seen}))
    threading.Thread(target=server.serve_forever, name="web", daemon=True).start()
    return server
