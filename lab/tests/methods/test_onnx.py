"""Files of networks: opened, run, refused in one line."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import unshutter
from unshutter import UnshutterError
from unshutter.cli import main
from unshutter.photo import Photo
from unshutter.single.register import method
from unshutter_lab.methods.onnx import run_network


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


@pytest.mark.parametrize("name", ["kandula2020-research", "rengarajan2017"])
def test_weights_that_are_none_are_told_in_one_line(
    name: str, tmp_path: Path, rolling_facade: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, text = tmp_path / "photo.png", tmp_path / "text.onnx"
    Photo.from_array(rolling_facade).save(photo)
    text.write_text("no network")
    other = method("rengarajan2017" if name == "kandula2020-research" else "kandula2020-research").weights
    for command in (["rectify", str(photo), "-o", str(tmp_path / "out.png")], ["estimate", str(photo)]):
        for weights, told in ((text, "PROTOBUF"), (other, "they are not")):
            assert main([*command, "--estimator", f"{name}@{weights}"]) == 1
            message = capsys.readouterr().err
            assert message.count("\n") == 1 and "cannot use the weights" in message and told in message
    assert not (tmp_path / "out.png").exists()


# ---- files that say they are the network, and are not --------------------------------------------------------


def endless(helper, types) -> list:
    """Loops that give back what they got, and never have enough."""
    scalar = {"dims": [], "data_type": types.BOOL}
    body = helper.make_graph(
        [helper.make_node("Identity", ["going"], ["still"]), helper.make_node("Identity", ["kept"], ["on"])],
        "body",
        [
            helper.make_tensor_value_info("n", types.INT64, []),
            helper.make_tensor_value_info("going", types.BOOL, []),
            helper.make_tensor_value_info("kept", types.FLOAT, [1, 3, 256, 256]),
        ],
        [
            helper.make_tensor_value_info("still", types.BOOL, []),
            helper.make_tensor_value_info("on", types.FLOAT, [1, 3, 256, 256]),
        ],
    )
    yes = helper.make_tensor("yes", scalar["data_type"], scalar["dims"], [True])
    return [
        helper.make_node("Constant", [], ["start"], value=yes),
        helper.make_node("Loop", ["", "start", "rs"], ["key_rows"], body=body),
    ]


def crash_at_opening(helper, types) -> list:
    """The least integer divided by -1, which processors do not do."""
    return [
        integer(helper, types, "least", [-(2**31)]),
        integer(helper, types, "minus", [-1]),
        helper.make_node("Div", ["least", "minus"], ["quotient"]),
        helper.make_node("Cast", ["quotient"], ["number"], to=types.FLOAT),
        helper.make_node("Mul", ["rs", "number"], ["key_rows"]),
    ]


def slow(helper, types) -> list:
    """One operation that takes long."""
    return [
        integer(helper, types, "shape", [8000, 8000], "INT64"),
        helper.make_node("ReduceMax", ["rs"], ["brightest"], keepdims=0),
        helper.make_node("Expand", ["brightest", "shape"], ["large"]),
        helper.make_node("MatMul", ["large", "large"], ["product"]),
        helper.make_node("ReduceMax", ["product"], ["number"], keepdims=0),
        helper.make_node("Mul", ["rs", "number"], ["key_rows"]),
    ]


@pytest.mark.parametrize(
    ("nodes", "rs", "told"),
    [
        (identity, (1, 3, 256, 256), "they are not rengarajan2017 weights"),
        (identity, (1, 3, 64, 64), "invalid dimensions"),
        (identity, (1, 256), "Invalid rank"),
        (crash_at_opening, (1, 3, 256, 256), "it makes its process crash"),
        (crash_at_running, (1, 3, 256, 256), "it makes its process crash"),
    ],
    ids=["another answer", "another size", "another rank", "a crash at opening", "a crash at running"],
)
def test_a_file_of_another_network_is_told_in_one_line(
    nodes, rs: tuple, told: str, tmp_path: Path, photo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = made(tmp_path / "odd.onnx", nodes, square_only, rs)
    assert main(["estimate", str(photo), "--estimator", f"rengarajan2017@{weights}"]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and f"cannot use the weights {weights}: " in message and told in message


@pytest.mark.parametrize("nodes", [endless, slow])
def test_a_network_without_an_end_is_ended_at_the_limit(nodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    weights = made(tmp_path / "long.onnx", nodes, square_only)
    monkeypatch.setattr("unshutter.single.own_process.LONGEST_RUN_S", 1.0)
    start = time.monotonic()
    with pytest.raises(UnshutterError, match=r"it took longer than 1 s"):
        unshutter.load(f"rengarajan2017@{weights}")
    assert time.monotonic() - start < 30  # not for ever; others may work beside it


def huge(helper, types) -> list:
    """13 gigabytes of one number."""
    return [
        integer(helper, types, "shape", [1, 3200, 1024, 1024], "INT64"),
        helper.make_node("ReduceMax", ["rs"], ["brightest"], keepdims=0),
        helper.make_node("Expand", ["brightest", "shape"], ["key_rows"]),
    ]


def huge_only(helper, kind) -> list:
    return [helper.make_tensor_value_info("key_rows", kind, [1, 3200, 1024, 1024])]


MEMORY_OF_ITS_PROCESS = """
import resource, sys, unshutter
try:
    unshutter.load(sys.argv[1])
except unshutter.UnshutterError as error:
    print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the memory of a process")
def test_a_network_with_an_endless_answer_is_ended_at_the_limit(tmp_path: Path) -> None:
    weights = made(tmp_path / "huge.onnx", huge, huge_only)
    code = [sys.executable, "-c", MEMORY_OF_ITS_PROCESS, f"rengarajan2017@{weights}"]
    peak_kb, message = subprocess.run(code, capture_output=True, text=True, check=True).stdout.split(" ", 1)
    assert "cannot use the weights" in message and "alloc" in message
    assert int(peak_kb) < 2**21


def test_weights_of_the_laboratory_itself_are_run() -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (80, 90, 3), dtype=np.uint8)
    for name in ("rengarajan2017", "rengarajan2017-vanilla", "kandula2020-research"):
        assert unshutter.estimate(pixels, estimator=name).estimator == name


def test_telemetry_is_off_before_onnxruntime_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is read once, when the library is loaded."""
    monkeypatch.delenv("ORT_DISABLE_TELEMETRY")
    stand_in = "import os\nraise ImportError('telemetry off: ' + os.environ.get('ORT_DISABLE_TELEMETRY', 'no'))\n"
    (tmp_path / "onnxruntime.py").write_text(stand_in)
    monkeypatch.syspath_prepend(tmp_path)
    weights = made(tmp_path / "identity.onnx", identity, square_only)
    with pytest.raises(UnshutterError, match="telemetry off: 1"):
        run_network("any", weights, np.zeros((1, 3, 256, 256), np.float32), "key_rows", (1, 3, 256, 256))
