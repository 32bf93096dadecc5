"""Draw the pictures of docs/matching.md from real runs on two Middlebury pairs.

    python tools/match_pictures.py [--output docs/images]

Needs the pairs of ``../shared/data``. Leaves ``matching_stages.jpg``, ``matching_move.jpg`` and ``matching_water.jpg``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "test" / "benchmark"))

from drowned_pairs import STEREO, Truth, drown, pairs  # noqa: E402
from matching import WATERS  # noqa: E402
from peers import METHODS  # noqa: E402

from uw_recon_ros.evaluate import fill_rows  # noqa: E402
from uw_recon_ros.files.images import write_image  # noqa: E402
from uw_recon_ros.match.planes import matcher  # noqa: E402
from uw_recon_ros.match.planes.data_cost import CostData, make_workspace, plane_cost  # noqa: E402
from uw_recon_ros.match.planes.expansion import Labelling, energy, expand  # noqa: E402
from uw_recon_ros.match.planes.min_cut import make_grid  # noqa: E402
from uw_recon_ros.match.planes.refinement import CELL, MARGIN, Pass, disparity_of  # noqa: E402
from uw_recon_ros.report.colors import REASONS, ColorBar, colorize  # noqa: E402
from uw_recon_ros.types import ByteImage, FloatImage, Status  # noqa: E402

INK, PAPER, MARK = (40, 40, 40), 255, (220, 40, 40)
GAP, LINE = 10, 18
REASON_COLORS = {
    Status.OCCLUDED: (190, 60, 60), Status.OUTSIDE: (70, 110, 180), Status.INCONSISTENT: (235, 170, 60),
    Status.LOW_TEXTURE: REASONS[Status.LOW_TEXTURE][0],
}  # fmt: skip


class Move(NamedTuple):
    """One move: the region, the plane, its costs there, and the labelling before and after."""

    box: tuple[int, int, int, int]
    plane: NDArray[np.float32]
    cost: FloatImage
    before: Labelling
    after: Labelling


def titled(image: ByteImage, title: str, width: int) -> ByteImage:
    """An RGB picture, scaled to a width, with a line of text above."""
    height = round(image.shape[0] * width / image.shape[1])
    method = cv2.INTER_NEAREST if width > image.shape[1] else cv2.INTER_AREA
    scaled = cv2.resize(image, (width, height), interpolation=method)
    page = np.full((height + LINE, width, 3), PAPER, np.uint8)
    page[LINE:] = scaled
    cv2.putText(page, title, (1, LINE - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.4, INK, 1, cv2.LINE_AA)
    return page


def sheet(rows: list[list[ByteImage]]) -> ByteImage:
    """Rows of pictures of one size each, a margin between."""

    def between(parts: list[ByteImage], axis: int) -> ByteImage:
        shape = list(parts[0].shape)
        shape[axis] = GAP
        white = np.full(shape, PAPER, np.uint8)
        return np.concatenate([x for part in parts for x in (white, part)] + [white], axis=axis)

    return between([between(row, 1) for row in rows], 0)


def errors(disparity: FloatImage, truth: Truth) -> ByteImage:
    """Error of the filled map, gray where right, red where over 1 px, white where not counted."""
    error = np.abs(fill_rows(disparity) - truth.disparity)
    shown = colorize(np.where(truth.mask, error, np.nan).astype(np.float32), ColorBar(0, 4, "px", "magma"))
    shown[~truth.mask] = PAPER
    return shown


def bad(disparity: FloatImage, truth: Truth) -> float:
    """Percent of the counted pixels, holes filled."""
    return float(100 * (~(np.abs(fill_rows(disparity) - truth.disparity) <= 1))[truth.mask].mean())


def reasons(status: ByteImage) -> ByteImage:
    """A colour a reason; valid pixels white."""
    shown = np.full((*status.shape, 3), PAPER, np.uint8)
    for reason, color in REASON_COLORS.items():
        shown[status == reason] = color
    return shown


def stages(truth: Truth) -> ByteImage:
    """Start, result, status, sigma, errors."""
    bar = ColorBar(
        float(np.nanmin(truth.disparity[truth.mask])) - 3, float(np.nanmax(truth.disparity[truth.mask])), "px"
    )
    start, result = (
        matcher.graph_cut(truth.left, truth.right, 0, truth.max_disparity - 1, effort=effort)
        for effort in ("navigation", "balanced")
    )
    sigma = ColorBar(0, 1, "px", "viridis")
    width = 300
    return sheet([
        [titled(truth.left, "left camera", width),
         titled(colorize(start.disparity, bar, start.status), "start: semi-global, both cameras agree", width),
         titled(colorize(result.disparity, bar, result.status), "balanced: planes moved by cuts", width)],
        [titled(reasons(result.status), "red: left camera only, blue: outside, tan: no texture", width),
         titled(errors(start.disparity, truth), f"error of the start: {bad(start.disparity, truth):.1f} %", width),
         titled(errors(result.disparity, truth), f"after the moves: {bad(result.disparity, truth):.1f} %", width)],
        [titled(colorize(result.sigma, sigma, result.status), "sigma, 0 (dark) to 1 px (bright)", width),
         titled(steps_of(start.disparity), "start, shaded: stairs", width),
         titled(steps_of(result.disparity), "planes, shaded: slopes", width)],
    ])  # fmt: skip


def steps_of(disparity: FloatImage) -> ByteImage:
    """The map lit from the left, as relief: what is flat is gray."""
    filled = fill_rows(disparity)
    slope = np.zeros_like(filled)
    slope[:, 1:-1] = (filled[:, 2:] - filled[:, :-2]) / 2
    return np.repeat(np.clip(128 + 500 * slope, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def before_the_cuts(truth: Truth) -> tuple[CostData, Labelling]:
    """What the first round of cuts begins with: the state after the passes without a cut."""
    kept: list[Any] = []
    real = matcher.refine

    def stopped(passes: tuple[Pass, ...], least_gain: float, *others: Any) -> None:
        real([p for p in passes if not p.cut], least_gain, *others)
        kept.extend(
            (
                next(o for o in others if isinstance(o, CostData)),
                next(o for o in others if isinstance(o, Labelling)),
            )
        )

    matcher.refine = stopped
    matcher.graph_cut(truth.left, truth.right, 0, truth.max_disparity - 1)
    matcher.refine = real
    return kept[0], kept[1]


def copied(state: Labelling) -> Labelling:
    """To try a move on."""
    return state._replace(planes=state.planes.copy(), costs=state.costs.copy())


def best_move(view: CostData, state: Labelling) -> Move:
    """Of planes seen near cells here and there, the one whose cut lowers the energy most."""
    height, width = state.costs.shape
    side = CELL + 2 * MARGIN
    work, grid = make_workspace(side), make_grid(side)
    best: tuple[int, Move | None] = (0, None)
    start = sum(energy(state))
    for row in range(2 * CELL, height - 2 * CELL, 3 * CELL):
        for column in range(4 * CELL, width - 2 * CELL, 3 * CELL):
            box = row - MARGIN, row + CELL + MARGIN, column - MARGIN, column + CELL + MARGIN
            for v, u in ((row, column), (row + CELL, column), (row, column + CELL), (row + CELL, column + CELL)):
                plane = state.planes[:, v, u].copy()
                plane_cost(*plane, *box, view, work)
                tried = copied(state)
                expand(*plane, *box, work.cost, tried, grid)
                gain = start - sum(energy(tried))
                if gain > best[0]:
                    best = gain, Move(box, plane, work.cost[:side, :side].copy(), state, tried)
    assert best[1] is not None
    return best[1]


def move(truth: Truth) -> ByteImage:
    """One expansion, step by step."""
    view, state = before_the_cuts(truth)
    one = best_move(view, state)
    top, bottom, left, right = one.box
    around = np.s_[top - 12 : bottom + 12, left - 12 : right + 12]
    maps = [disparity_of(s.planes)[around] for s in (one.before, one.after)]
    bar = ColorBar(float(min(m.min() for m in maps)), float(max(m.max() for m in maps)), "px")
    tried = one.after.planes == one.plane[:, None, None]
    moved = tried.all(axis=0) & (one.before.planes != one.plane[:, None, None]).any(axis=0)
    cheaper = np.zeros(state.costs.shape, np.float32)
    cheaper[top:bottom, left:right] = one.cost - one.before.costs[top:bottom, left:right]
    drop = (sum(energy(one.before)) - sum(energy(one.after))) / float(state.units)
    width = 180
    pictures = [
        (truth.left[around], "left camera, one tile"),
        (colorize(maps[0], bar), "planes before"),
        (colorize(cheaper[around], ColorBar(-1, 1, "", "diverging")), "red: new plane costs more"),
        (marked(truth.left[around], moved[around]), "the cut takes these"),
        (colorize(maps[1], bar), f"after: energy -{drop:.0f}"),
    ]
    return sheet([[titled(extend_borders(image), title, width) for image, title in pictures]])


def marked(image: ByteImage, mask: NDArray[np.bool_]) -> ByteImage:
    """Half covered in red where the mask says so."""
    shown = image.copy()
    shown[mask] = shown[mask] // 2 + np.array(MARK, np.uint8) // 2
    return shown


def extend_borders(image: ByteImage) -> ByteImage:
    """The tile's outline, 12 px inside, on four times as many pixels."""
    large = cv2.resize(image, None, fx=4, fy=4, interpolation=cv2.INTER_NEAREST)
    cv2.rectangle(large, (48, 48), (large.shape[1] - 49, large.shape[0] - 49), MARK, 1)
    return large


def water(truth: Truth) -> ByteImage:
    """A pair in haze and in noise, by stereo_image_proc's matcher and by this one."""
    bar = ColorBar(
        float(np.nanmin(truth.disparity[truth.mask])) - 1, float(np.nanmax(truth.disparity[truth.mask])), "px"
    )
    rows = []
    for name in ("hazy", "noisy"):
        left, right = drown(truth, WATERS[name])
        peer = METHODS["stereo_image_proc SGBM"](1)(left, right, truth.max_disparity).disparity
        mine = matcher.graph_cut(left, right, 0, truth.max_disparity - 1)
        width = 300
        rows.append([
            titled(left, f"{name}, left camera", width),
            titled(colorize(peer, bar), f"stereo_image_proc SGBM: {bad(peer, truth):.1f} % over 1 px", width),
            titled(colorize(mine.disparity, bar, mine.status), f"balanced: {bad(mine.disparity, truth):.1f} %", width),
        ])  # fmt: skip
    return sheet(rows)


def main() -> int:
    """Draw all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "images")
    output = parser.parse_args().output
    if not STEREO.is_dir():
        sys.stderr.write(f"{STEREO}: expected the Middlebury pairs, got nothing\n")
        return 1
    by_name = {pair.name: pair for pair in pairs()}
    drawn = {"stages": stages(by_name["teddy"]), "move": move(by_name["teddy"]), "water": water(by_name["teddy"])}
    for name, image in drawn.items():
        write_image(output / f"matching_{name}.jpg", image)
    return 0


if __name__ == "__main__":
    sys.exit(main())
