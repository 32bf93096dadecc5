"""Plans as bytes: everything comes back as it was, and nothing that was not expected is made."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from uw_recon_ros.files.packed import pack, unpack
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.types import CalibrationOrigin, RectificationQuality, Window


@dataclasses.dataclass(frozen=True)
class Box:
    content: Any


def test_everything_comes_back_bit_for_bit() -> None:
    array = np.random.default_rng(0).normal(size=(3, 4)).astype(np.float32)[:, ::-1]
    given = {
        -1: Box((1, 2.5, None, True, "\u03b1", [Window(1, 2, 3, 4)])),
        3: [array, np.arange(4, dtype=np.uint16), 0.1 + 0.2, -0.0, math.inf],
    }
    back = unpack(pack(given), [Box, Window])
    assert back[-1] == given[-1]
    assert back[3][0].dtype == np.float32
    np.testing.assert_array_equal(back[3][0], array)
    assert (back[3][1].dtype, back[3][2], math.copysign(1, back[3][3]), back[3][4]) == (
        np.uint16,
        0.1 + 0.2,
        -1,
        math.inf,
    )
    quality = unpack(pack(RectificationQuality("given")), [RectificationQuality, CalibrationOrigin])
    assert math.isnan(quality.row_error_median_px)


def test_only_expected_classes_are_made() -> None:
    with pytest.raises(KeyError, match="Box"):
        unpack(pack(Box(1)), [Window])


def test_what_is_no_data_is_refused() -> None:
    with pytest.raises(TypeError, match="got builtin_function_or_method"):
        pack([print])


def test_findings_come_back_as_what_they_were() -> None:
    found = Finding(Code.RECTIFY_FLAT_SCENE, "flat", Severity.UNRELIABLE, "dive deeper")
    (back,) = unpack(pack((found,)), [Finding])
    assert back == found
    assert isinstance(back.code, Code)
    assert isinstance(back.severity, Severity)
