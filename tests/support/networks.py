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


def integer(helper, types, name: str, values: list[int], kind: str = "INT32"):
    """A node that gives these numbers."""
    return helper.make_node(
        "Constant", [], [name], value=helper.make_tensor(name, getattr(types, kind), [len(values)], values)
    )


def crash_at_running(helper, types) -> list:
    """The least integer divided by -1 if the darkest value is less than 1: processors do not do that."""
    return [
        integer(helper, types, "least", [-(2**31)]),
        integer(helper, types, "one", [1]),
        helper.make_node("ReduceMin", ["rs"], ["darkest"], keepdims=0),
        helper.make_node("Cast", ["darkest"], ["zero"], to=types.INT32),
        helper.make_node("Sub", ["zero", "one"], ["minus"]),
        helper.make_node("Div", ["least", "minus"], ["quotient"]),
        helper.make_node("Cast", ["quotient"], ["number"], to=types.FLOAT),
        helper.make_node("Mul", ["rs", "number"], ["key_rows"]),
    ]
