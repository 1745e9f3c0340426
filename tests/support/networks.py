"""Small networks in ONNX files, made on the fly."""

from pathlib import Path

import pytest


def made(path: Path, nodes: list, answers: list, rs: tuple = (1, 3, 256, 256)) -> Path:
    """A network of such nodes that takes a picture, as rengarajan2017 does."""
    onnx = pytest.importorskip("onnx", reason="making networks for the tests needs onnx")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    given = [helper.make_tensor_value_info("rs", kind, rs)]
    graph = helper.make_graph(nodes(helper, onnx.TensorProto), "graph", given, answers(helper, kind))
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


def identity(helper, types) -> list:
    return [helper.make_node("Identity", ["rs"], ["key_rows"])]


def square_only(helper, kind) -> list:
    return [helper.make_tensor_value_info("key_rows", kind, [1, 3, 256, 256])]
