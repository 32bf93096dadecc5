"""Tiny stereo networks, made here: the least sum of differences over 5x5 pixels of a few whole disparities."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
from onnx import TensorProto, helper, numpy_helper  # noqa: E402

REACH = 16  #: disparities from 0 on


def write_network(
    path: Path,
    *,
    size: tuple[int, int] | None = None,
    channels: int = 3,
    one_input: bool = False,
    names: tuple[str, str] = ("left", "right"),
    flow: bool = False,
    rank: int = 4,
    also: bool = False,
    broken: bool = False,
    scale: float = 1.0,
    kind: int = TensorProto.FLOAT,
) -> Path:
    """Write one.

    Parameters
    ----------
    path : Path
    size : (int, int), optional
        Fixed width and height.
    channels : int
        Of one image.
    one_input : bool
        Both images laid upon each other.
    names : (str, str)
        Of the inputs, in the order of the file.
    flow : bool
        Give the disparity with its sign turned, and a second channel of zeros.
    rank : int
        Dimensions of the output, 2 to 4.
    also : bool
        Give a second output of the same size, all 0.5.
    broken : bool
        Fails when it is run.
    scale : float
        Times the disparity: NaN to see what happens then.
    kind : int
        Type of the inputs.
    """
    nodes: list[Any] = []
    constants: list[Any] = []

    def constant(name: str, values: Any, kind: Any = np.int64) -> str:
        constants.append(numpy_helper.from_array(np.array(values, kind), name))
        return name

    def add(operator: str, inputs: list[str], output: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(operator, inputs, [output], **attributes))
        return output

    width, height = size or ("w", "h")
    shape = [1, 2 * channels if one_input else channels, height, width]
    if one_input:
        inputs = [helper.make_tensor_value_info("pair", kind, shape)]
        add("Split", ["pair", constant("halves", [channels, channels])], "left_raw", axis=1)
        nodes[-1].output.append("right_raw")
        raw = ["left_raw", "right_raw"]
    else:
        inputs = [helper.make_tensor_value_info(name, kind, shape) for name in names]
        raw = ["left", "right"] if set(names) == {"left", "right"} else list(names)
    left, right = (add("Cast", [name], f"float_{i}", to=TensorProto.FLOAT) for i, name in enumerate(raw))
    costs = []
    for d in range(REACH):
        padded = add("Pad", [right, constant(f"pads{d}", [0, 0, 0, d, 0, 0, 0, 0])], f"padded{d}", mode="edge")
        ends = constant(f"ends{d}", [-d if d else 2**31 - 1])
        moved = add("Slice", [padded, constant(f"from{d}", [0]), ends, constant(f"axis{d}", [3])], f"moved{d}")
        apart = add("Abs", [add("Sub", [left, moved], f"apart{d}")], f"size{d}")
        gray = add("ReduceMean", [apart], f"gray{d}", axes=[1], keepdims=1)
        costs.append(add("AveragePool", [gray], f"cost{d}", kernel_shape=[5, 5], pads=[2, 2, 2, 2]))
    best = add("ArgMin", [add("Concat", costs, "costs", axis=1)], "best", axis=1, keepdims=1)
    found = add("Cast", [best], "whole", to=TensorProto.FLOAT)
    found = add("Mul", [found, constant("scale", scale, np.float32)], "disparity_4")
    if broken:
        found = add("Reshape", [found, constant("seven", [1, 1, 7, 7])], "disparity_7")
    if flow:
        none = add("Mul", [found, constant("none", 0.0, np.float32)], "rows")
        found = add("Concat", [add("Neg", [found], "turned"), none], "flow", axis=1)
    if rank < 4:
        found = add("Squeeze", [found, constant("axes", list(range(4 - rank)))], "squeezed")
    outputs = [helper.make_tensor_value_info(add("Identity", [found], "disparity"), TensorProto.FLOAT, [None] * rank)]
    if also:
        half = add("Add", [add("Mul", ["whole", constant("zero", 0.0, np.float32)], "zeros"),
                           constant("half", 0.5, np.float32)], "certainty")  # fmt: skip
        outputs.append(helper.make_tensor_value_info(half, TensorProto.FLOAT, [None] * 4))
    graph = helper.make_graph(nodes, "least differences", inputs, outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path
