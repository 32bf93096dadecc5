"""A calibration session while the cameras run: pairs gathered one by one, what they cover, a picture that shows it."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np

from uw_recon_ros.board_kinds import CHECKERBOARD
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.advice import lacking
from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.coverage import covered, near_points
from uw_recon_ros.calibrate.detect import Sighting, find_board
from uw_recon_ros.calibrate.pair_selection import seen_before, unseen_reason
from uw_recon_ros.calibrate_files import BoardAsked, Result, Seen, calibrate_seen, made_board
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import ByteImage, Mask

_REMEMBERED = 1500  # pairs, kept or not, in which partners of another moment are looked for
_SHOWN_PX = 640  # width of either picture
_DOT, _SEEN = (60, 220, 255), (70, 140, 40)  # BGR


@dataclass(frozen=True, eq=False)
class Looked:
    """What one pair showed.

    Parameters
    ----------
    left, right : Sighting or None
    note : str
        Why it was not kept; empty where it was.
    """

    left: Sighting | None
    right: Sighting | None
    note: str


@dataclass(eq=False)
class LiveSession:
    """Gathers pairs. Methods may be called from any thread.

    Parameters
    ----------
    asked : BoardAsked
        A checkerboard's size may be left open: it is found.
    medium : {'water', 'air', 'unknown'}
    most : int
        Pairs kept at most.
    """

    asked: BoardAsked
    medium: str = "unknown"
    most: int = 150
    board: Board | None = None
    pairs: list[SeenPair] = field(default_factory=list)
    size: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        self._lock, self._looked = threading.Lock(), 0
        self._seen: deque[SeenPair] = deque(maxlen=_REMEMBERED)
        if self.board is None and (self.asked.size or self.asked.kind != CHECKERBOARD):
            self.board = made_board(self.asked, [])

    def add(self, seen: Seen) -> Looked:
        """Look for the board in a pair, and keep it where it shows it somewhere new.

        Raises
        ------
        CalibrationError
            The pair is of another size than those before.
        """
        if self.pairs and seen.size != self.size:
            got, wanted = (f"{w}x{h}" for w, h in (seen.size, self.size))
            raise CalibrationError(f"pair: expected {wanted} px as before, got {got}", Code.CALIBRATE_SIZE_DIFFERS)
        self._looked += 1
        if self.board is None:
            try:
                self.board = made_board(self.asked, [seen])
            except CalibrationError:
                return Looked(None, None, "no checkerboard found yet")
        left, right = find_board(seen.left, self.board), find_board(seen.right, self.board)
        note = unseen_reason(left, right) or ""
        if left is not None and right is not None:
            pair = SeenPair(seen.name, left, right, self._looked)
            with self._lock:
                self._seen.append(pair)
            note = note or self._kept(pair, seen.size)
        return Looked(left, right, note)

    def _kept(self, pair: SeenPair, size: tuple[int, int]) -> str:
        if seen_before(pair, self.pairs, size):
            return "the board is where it was: move it"
        if len(self.pairs) >= self.most:
            return f"{self.most} pairs are kept already"
        with self._lock:
            self.size = size
            self.pairs.append(pair)
        return ""

    @property
    def near(self) -> tuple[Mask, Mask]:
        """What of the left and of the right image is near a point of the board, see `calibrate.coverage`."""
        pairs, size = list(self.pairs), self.size if self.pairs else (4, 3)
        left, right = (near_points([getattr(p, side) for p in pairs], size) for side in ("left", "right"))
        return left, right

    def advice(self) -> str:
        """What to do next, in a few words."""
        if not self.pairs:
            return "hold the board before both cameras"
        bare = lacking(min(self.near, key=covered)) or lacking(max(self.near, key=covered))
        if bare:
            return f"hold the board towards the {bare}, tilted"
        return "tilt the board to all sides, near and far"

    def solve(self) -> Result:
        """Calibrate with what there is.

        Raises
        ------
        CalibrationError
            It is not enough.
        """
        with self._lock:
            pairs, among = list(self.pairs), list(self._seen)
        if self.board is None or not pairs:
            raise CalibrationError("pairs of the board: got none yet", Code.CALIBRATE_NOT_SEEN)
        metric = self.asked.square_m > 0
        return calibrate_seen((pairs, [], self.size), self.board, metric=metric, medium=self.medium, among=among)


def annotated(seen: Seen, looked: Looked, session: LiveSession) -> ByteImage:
    """Both pictures side by side, (H, W, 3) RGB: parts that are covered, the board's points, what to do."""
    sides = zip((seen.left, seen.right), (looked.left, looked.right), session.near, strict=True)
    shown = np.hstack([_side(*side) for side in sides])
    words = f"{len(session.pairs)} pairs. {looked.note or 'kept'}; {session.advice()}"
    bar = np.full((28, shown.shape[1], 3), 30, np.uint8)
    cv2.putText(bar, words, (8, 19), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return np.ascontiguousarray(np.vstack([bar, shown])[..., ::-1])


def _side(gray: ByteImage, sighting: Sighting | None, near: Mask) -> ByteImage:
    scale = min(_SHOWN_PX / gray.shape[1], 1.0)
    small = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    picture = np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), np.uint8)
    shown = cv2.resize(near.astype(np.uint8), picture.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0
    picture[shown] = (0.75 * picture[shown] + 0.25 * np.array(_SEEN)).astype(np.uint8)
    for u, v in () if sighting is None else np.rint(scale * sighting.pixels).astype(int):
        cv2.circle(picture, (int(u), int(v)), 3, _DOT, -1, cv2.LINE_AA)
    return picture
