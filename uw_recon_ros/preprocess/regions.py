"""Parts of an image that show no scene: constant borders, and what a camera has lost (dead, noise, frozen).

Looked for on the raw images, in blocks of 8 x 8 px, since what is lost is exact where a scene never is: a sensor's
noise changes every row and column of the emptiest water. A camera is held against the other one: what both do not
tell is the scene's (mud, open water), and left to the matcher. So is glare on less of the image than a lamp can fill.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.preprocess.image_pairs import TwoThreads, checked_images, full_scale
from uw_recon_ros.types import Mask, RawImage, StereoPair
from uw_recon_ros.unseen_pixels import with_margin

BLOCK = 8  #: px
_SMALLEST_SIDE = 4 * BLOCK  # px, of an image that is looked at
MUCH = 0.1  #: of an image; more is worth a warning
_STILL = 0.02  # of a block's pixels that may change (along a direction, since the frame before) where nothing does
_SMALLEST = 0.01  # of an image that a lost part must cover
_ALSO = 0.5  # of a part's place, or area, that the other camera does not tell either: then it is the scene's
_NOISE_LEVEL = 12.0  # mean difference of neighbours from which a picture is held for mere noise, of 255 ...
_NOISE_RATIO = 1.25  # ... if pixels 6 px apart do not differ more than this times as much
_NOISE_LAG = 6  # px
_BLANK_LEVEL = 4.0  # mean difference up to which it is blank
_FROM_SIDE_TO_SIDE, _BAND, _NEARLY_HALF = 0.9, 0.2, 0.4  # of a row, of the rows, of the image
_NOISE_SMALLEST = 0.05  # of an image
_RING_SHARE = 0.04  # of an image's outermost pixels that must have one value for a border to be looked for
_GLARE = 0.3  # of an image
_BORDER_SMALLEST = 0.002  # of an image, connected
_BORDER_TOLERANCE = 2  # gray levels of 8 bits: what compression makes of a constant
_BORDER_NOISE = 0.2  # most mean difference of neighbours in a border, digits
_BORDER_COLORS = 3  # at most so many values are looked for
_NEARLY_ALL = 0.95  # of an image: then it is blank, and has no border
_HOLE = 0.02  # of an image: what a border encloses up to this size belongs to it: letters

Gray = NDArray[Any]  #: uint8 or uint16
Blocks = Mask
Grays = tuple[Gray, Gray]


@dataclass(frozen=True, eq=False)
class Regions:
    """What neither camera of a pair shows.

    Parameters
    ----------
    left, right : (H, W) bool
        True where nothing is seen, margin included.
    findings : tuple of Finding
        Named after the camera; a warning from a tenth of the image on.
    """

    left: Mask
    right: Mask
    findings: tuple[Finding, ...] = ()

    @property
    def masks(self) -> tuple[Mask, Mask]:
        """Left and right."""
        return self.left, self.right


class RegionWatch:
    """Finds the regions of frames in a row: what stands still in one camera alone is frozen.

    Deterministic: the same frames in a row give the same regions.
    """

    def __init__(self) -> None:
        self._before: Grays | None = None

    def update(self, pair: StereoPair) -> Regions:
        """Look at the next pair.

        Raises
        ------
        ImageError, TypeError
            As `checked_images`.
        """
        grays = _grays(pair)
        found = _find(grays, self._before)
        self._before = grays
        return found


def find_regions(pair: StereoPair, before: StereoPair | None = None) -> Regions:
    """Find what a pair does not show; what is frozen, with the pair before it. See `RegionWatch`."""
    return _find(_grays(pair), None if before is None else _grays(before))


def _grays(pair: StereoPair) -> Grays:
    with TwoThreads() as both:
        return both(_gray, checked_images(pair))


def _gray(image: RawImage) -> Gray:
    """The brightest channel: full where any is, so that glare is known, and 0 only where all are."""
    if image.ndim == 2:
        return image
    red, green, blue = cv2.split(image)
    return np.asarray(cv2.max(cv2.max(red, green), blue))


class _Alone(NamedTuple):
    """What one image tells by itself: its border, (H, W), and blocks that may be lost."""

    border: Mask
    dead: Blocks
    noise: Blocks
    blank: Blocks


def _alone(gray: Gray, white: float) -> _Alone:
    return _Alone(constant_border(gray, white), _dead(gray, white), *_without_picture(gray))


def _find(grays: Grays, before: Grays | None) -> Regions:
    nothing = np.zeros(grays[0].shape, np.bool_)
    if min(grays[0].shape) < _SMALLEST_SIDE:
        return Regions(nothing, nothing)
    with TwoThreads() as both:
        alone = both(partial(_alone, white=full_scale(grays)), grays)
    kinds = {
        code: pair for code, pair in _kinds(alone, _still(grays, before)).items() if pair[0].any() or pair[1].any()
    }
    borders = alone[0].border, alone[1].border
    if not kinds and not borders[0].any() and not borders[1].any():
        return Regions(nothing, nothing)
    masks, findings = [], list[Finding]()
    for camera, (name, border) in enumerate(zip(("left", "right"), borders, strict=True)):
        parts = {code: _as_pixels(pair[camera], border.shape) & ~border for code, pair in kinds.items()}
        masks.append(with_margin(np.logical_or.reduce([border, *parts.values()])))
        findings += [_finding(code, name, float(part.mean())) for code, part in parts.items() if part.any()]
        findings += _border_finding(name, border, borders)
    return Regions(masks[0], masks[1], tuple(findings))


def _kinds(alone: tuple[_Alone, _Alone], still: tuple[Blocks, Blocks] | None) -> dict[Code, tuple[Blocks, Blocks]]:
    """Blocks that either camera has lost, by kind."""
    dead = _unlike_the_other((alone[0].dead, alone[1].dead))
    noise, blank = (alone[0].noise, alone[1].noise), _wide((alone[0].blank, alone[1].blank))
    kinds = {
        Code.REGION_DEAD: dead,
        Code.REGION_NOISE: (_only_in(noise, 0), _only_in(noise, 1)),
        Code.REGION_BLANK: (blank[0] & ~dead[0], blank[1] & ~dead[1]),
    }
    if still is not None:
        frozen = _unlike_the_other(still)
        kinds[Code.REGION_FROZEN] = frozen[0] & ~dead[0], frozen[1] & ~dead[1]
    return kinds


def _still(grays: Grays, before: Grays | None) -> tuple[Blocks, Blocks] | None:
    """Blocks of either camera that are those of the frame before; None where there is none of this kind."""
    if before is None or before[0].shape != grays[0].shape or before[0].dtype != grays[0].dtype:
        return None
    left, right = (
        _share(cv2.absdiff(now, then), now.shape) <= 255 * _STILL for now, then in zip(grays, before, strict=True)
    )
    return left, right


def _blocks(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Means over blocks; what is over at the right and the bottom belongs to no block."""
    rows, columns = (size // BLOCK for size in values.shape)
    whole = np.ascontiguousarray(values[: rows * BLOCK, : columns * BLOCK])
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA))


def _share(changed: Gray, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Share of each block's pixels that are not 0, of 255; `changed` may lack the last row or column of `shape`."""
    image = np.zeros(shape, np.uint8)
    image[: changed.shape[0], : changed.shape[1]] = 255 * (changed != 0)
    return _blocks(image)


def _dead(gray: Gray, white: float) -> Blocks:
    """Blocks all of whose rows, or all of whose columns, are alike: one value, or a line again and again; no glare."""
    down = _share(cv2.absdiff(gray[1:], gray[:-1]), gray.shape)
    along = _share(cv2.absdiff(gray[:, 1:], gray[:, :-1]), gray.shape)
    alike = np.minimum(down, along) <= 255 * _STILL
    bright = _share(gray >= white, gray.shape) >= 255 * (1 - _STILL) if alike.any() else np.zeros_like(alike)
    return np.asarray(alike & ~bright if bright.mean() < _GLARE else alike)


def _without_picture(gray: Gray) -> tuple[Blocks, Blocks]:
    """Blocks whose pixels have nothing to do with each other: in bold contrast (noise), and in hardly any (blank)."""
    levels = gray if gray.dtype == np.uint8 else gray * np.float32(255.0 / max(float(gray.max()), 1.0))
    bold, faint = _unrelated(levels)
    if max(bold.mean(), faint.mean()) < _NOISE_SMALLEST:
        return np.zeros_like(bold), np.zeros_like(faint)
    other_bold, other_faint = _unrelated(levels.T)
    return bold & other_bold.T, faint & other_faint.T


def _unrelated(levels: NDArray[Any]) -> tuple[Blocks, Blocks]:
    """Blocks where pixels further apart along the row hardly differ more than neighbours; by how much these do."""
    near, far = (_mean_difference(levels, lag) for lag in (1, _NOISE_LAG))
    random = (far <= _NOISE_RATIO * near) & (near > 0)
    return np.asarray(random & (near >= _NOISE_LEVEL)), np.asarray(random & (far <= _BLANK_LEVEL))


def _mean_difference(levels: NDArray[Any], lag: int) -> NDArray[np.float32]:
    """Mean over blocks and those around them, of every other row."""
    size = levels.shape[1] // BLOCK, levels.shape[0] // BLOCK
    difference = cv2.absdiff(levels[::2, lag:], levels[::2, :-lag]).astype(np.float32)
    return np.asarray(cv2.blur(cv2.resize(difference, size, interpolation=cv2.INTER_AREA), (3, 3)), np.float32)


def _parts(blocks: Blocks, smallest: float) -> list[Mask]:
    """Connected parts, small gaps closed."""
    if np.count_nonzero(blocks) < smallest * blocks.size:
        return []
    closed = cv2.morphologyEx(blocks.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(closed)
    areas = np.bincount(labels.ravel(), minlength=count)
    return [labels == i for i in range(1, count) if areas[i] >= max(smallest * blocks.size, 2)]


def _unlike_the_other(blocks: tuple[Blocks, Blocks]) -> tuple[Blocks, Blocks]:
    """Parts of either camera where the other one, at the same place, is not so."""
    lost = [np.zeros_like(blocks[0]), np.zeros_like(blocks[0])]
    for mine, other, kept in zip(blocks, blocks[::-1], lost, strict=True):
        for part in _parts(mine, _SMALLEST):
            if other[part].mean() < _ALSO:
                kept |= part
    return lost[0], lost[1]


def _only_in(blocks: tuple[Blocks, Blocks], camera: int) -> Blocks:
    """Parts of a camera of which the other one has nothing like as much, anywhere: fine sand moves with disparity."""
    mine, other = blocks[camera], blocks[1 - camera]
    kept = np.zeros_like(mine)
    for part in _parts(mine, _NOISE_SMALLEST):
        if other.sum() < _ALSO * part.sum():
            kept |= _with_rim(part, 1)
    return kept


def _wide(blank: tuple[Blocks, Blocks]) -> tuple[Blocks, Blocks]:
    """Blank parts of either camera, with the blocks at their rim, that are too wide to lie beside the other's view."""
    kept = [np.zeros_like(blank[0]), np.zeros_like(blank[0])]
    for mine, found in zip(_unlike_the_other(blank), kept, strict=True):
        for part in _parts(mine, _NOISE_SMALLEST):
            if _is_wide(part):
                found |= _with_rim(part, 2)
    return kept[0], kept[1]


def _with_rim(part: Blocks, width: int) -> Blocks:
    """With blocks that are only partly so, `width` of them."""
    side = 2 * width + 1
    return np.asarray(cv2.dilate(part.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)


def _is_wide(part: Blocks) -> bool:
    """Whether a part goes from side to side of many rows, or is nearly half the image."""
    rows = (part.mean(axis=1) >= _FROM_SIDE_TO_SIDE).mean()
    return bool(rows >= _BAND or part.mean() >= _NEARLY_HALF)


def _as_pixels(blocks: Blocks, shape: tuple[int, ...]) -> Mask:
    """The blocks' pixels; those over at the right and the bottom go with their neighbours."""
    if not blocks.any():
        return np.zeros(shape, np.bool_)
    pixels = blocks.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)
    over = [(0, size - have) for size, have in zip(shape, pixels.shape, strict=True)]
    return np.pad(pixels, over, mode="edge")


def constant_border(gray: Gray, white: float = 255.0) -> Mask:
    """A frame of one value around a picture: letterbox, fisheye circle, bar with letters.

    Parameters
    ----------
    gray : (H, W) uint8 or uint16
    white : float
        What is so bright is glare, and no border.

    Returns
    -------
    (H, W) bool
        Connected with the image's edge. Nothing where it would be nearly the whole image.
    """
    border = np.zeros(gray.shape, np.bool_)
    for value in _ring_values(gray):
        if value + _BORDER_TOLERANCE < white:
            border |= _connected(gray, value)
    if border.any():
        border = _without_holes(border)
    return border if border.mean() < _NEARLY_ALL else np.zeros_like(border)


def _ring(image: NDArray[np.generic]) -> NDArray[np.generic]:
    """The outermost pixels in their order."""
    return np.concatenate([image[0], image[:, -1], image[-1, ::-1], image[::-1, 0]])


def _ring_values(gray: Gray) -> list[int]:
    """Values that many of the outermost pixels have, beside each other and without noise."""
    ring = _ring(gray).astype(np.int64)
    counts = np.bincount(ring)
    frequent = np.argsort(-counts, kind="stable")[:_BORDER_COLORS]
    return [int(value) for value in frequent if _without_noise(ring, int(value), gray.dtype == np.uint8)]


def _without_noise(ring: NDArray[np.int64], value: int, bytes_: bool) -> bool:
    alike = np.abs(ring - value) <= (_BORDER_TOLERANCE if bytes_ else 0)
    both = alike[1:] & alike[:-1]
    if np.count_nonzero(both) < _RING_SHARE * ring.size:
        return False
    return bool(np.abs(np.diff(ring))[both].mean() <= _BORDER_NOISE)


def _connected(gray: Gray, value: int) -> Mask:
    """Pixels of about a value that hang together with the image's edge, if they are as even as no scene is."""
    tolerance = _BORDER_TOLERANCE if gray.dtype == np.uint8 else 0
    alike = _without_threads(cv2.inRange(gray, max(value - tolerance, 0), value + tolerance))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(alike, connectivity=4)
    kept = np.zeros(count, np.bool_)
    kept[np.unique(_ring(labels))] = True
    kept &= stats[:, cv2.CC_STAT_AREA] >= _BORDER_SMALLEST * gray.size
    kept[0] = False
    for label in np.flatnonzero(kept):
        kept[label] = _unevenness(gray, labels == label) <= _BORDER_NOISE
    return np.asarray(kept[labels])


def _without_threads(alike: NDArray[Any]) -> NDArray[Any]:
    """Without what is thinner than 3 px, beyond the image's edge it goes on: pixels of the scene that happen to fit."""
    framed = cv2.copyMakeBorder(alike, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    opened = cv2.morphologyEx(framed, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.ascontiguousarray(opened[1:-1, 1:-1])


def _unevenness(gray: Gray, part: Mask) -> float:
    """Mean difference of neighbours along rows within a part, digits."""
    both = part[:, 1:] & part[:, :-1]
    return float(cv2.mean(cv2.absdiff(gray[:, 1:], gray[:, :-1]), both.astype(np.uint8))[0])


def _without_holes(border: Mask) -> Mask:
    """With the small things that it encloses, gaps as wide as a block of a JPEG closed."""
    width = BLOCK + 1
    framed = cv2.copyMakeBorder(border.astype(np.uint8), width, width, width, width, cv2.BORDER_REPLICATE)
    closed = cv2.morphologyEx(framed, cv2.MORPH_CLOSE, np.ones((width, width), np.uint8))[width:-width, width:-width]
    count, labels = cv2.connectedComponents(1 - closed, connectivity=4)
    areas = np.bincount(labels.ravel(), minlength=count)
    small = areas < _HOLE * border.size
    small[0] = True
    return np.asarray(small[labels])


_WORDS = {
    Code.REGION_DEAD: ("shows nothing (one value, or one line repeated)", "check cable, transfer and port"),
    Code.REGION_NOISE: ("is noise without a picture", "look at cable and receiver"),
    Code.REGION_BLANK: ("shows nothing but noise", "check the port: silt, growth, a hand"),
    Code.REGION_FROZEN: ("is that of the frame before, while the other camera moves on", "look at the transfer"),
}


def _finding(code: Code, camera: str, share: float) -> Finding:
    what, advice = _WORDS[code]
    text = f"{camera} camera: {share:.0%} of the image {what}, where the other camera shows a scene; left out"
    return Finding(code, text, Severity.WARN if share > MUCH else Severity.OK, advice)


def _border_finding(camera: str, border: Mask, both: tuple[Mask, Mask]) -> list[Finding]:
    """A border is made on purpose where the other camera has it, and the opposite side; half an image is not."""
    if not border.any():
        return []
    if (both[0] & both[1]).sum() < _ALSO * border.sum():
        return [_finding(Code.REGION_DEAD, camera, float(border.mean()))]
    one_sided = float((border & ~border[::-1, ::-1]).mean())
    text = f"{camera} camera: a border of one value on {border.mean():.0%} of the image; left out"
    severe = Severity.WARN if one_sided > MUCH else Severity.OK
    return [Finding(Code.REGION_BORDER, text, severe, "look at cable and transfer" if severe else "")]
