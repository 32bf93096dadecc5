"""A mask that travels in its image: written, read again, continued over."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as some

from uw_recon_ros.unseen_pixels import MARGIN, blackened, continued, mark_unseen, unseen, with_margin

SHAPES = st.tuples(st.integers(1, 24), st.integers(1, 24))


@st.composite
def image_and_mask(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    shape = draw(SHAPES)
    return draw(some.arrays(np.uint8, shape)), draw(some.arrays(np.bool_, shape, elements=st.booleans()))


@given(image_and_mask())
def test_what_is_marked_is_read_again_whatever_its_shape(drawn: tuple[np.ndarray, np.ndarray]) -> None:
    image, mask = drawn
    spoilt = with_margin(mask)
    assert spoilt[mask].all()
    marked = mark_unseen(image, spoilt)
    np.testing.assert_array_equal(unseen(marked), spoilt)
    np.testing.assert_array_equal(marked[~spoilt], np.maximum(image, 1)[~spoilt])
    assert np.array_equal(unseen(np.dstack([marked] * 3)), spoilt)


def test_dark_pixels_are_part_of_a_picture() -> None:
    image = np.random.default_rng(0).integers(0, 2, (60, 80), np.uint8)
    image[20:26, 20:60] = 0
    assert not unseen(image).any()
    image[20:27, 20:60] = 0
    assert unseen(image)[20:27, 20:60].all()


@given(image_and_mask())
def test_what_is_seen_stays_and_nothing_is_invented(drawn: tuple[np.ndarray, np.ndarray]) -> None:
    image, mask = drawn
    filled = continued(image, mask)
    np.testing.assert_array_equal(filled[~mask], image[~mask])
    if not mask.all():
        assert np.isin(filled, image[~mask]).all()
    np.testing.assert_array_equal(blackened(image.copy(), mask) == 0, mask | (image == 0))


def test_a_half_is_continued_by_its_mirror_image() -> None:
    image = np.random.default_rng(0).integers(1, 255, (40, 30, 3), np.uint8)
    mask = np.zeros((40, 30), np.bool_)
    mask[20:] = True
    np.testing.assert_array_equal(continued(image, mask)[20:39], image[:19][::-1])


def test_the_margin_is_as_stated() -> None:
    mask = np.zeros((20, 20), np.bool_)
    mask[10, 10] = True
    assert with_margin(mask).sum() == (2 * MARGIN + 1) ** 2
