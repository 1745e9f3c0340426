"""Files of networks: opened, run, refused in one line."""

import sys
from pathlib import Path

import numpy as np
import pytest

import unshutter
from unshutter import UnshutterError
from unshutter.cli import main
from unshutter.photo import Photo
from unshutter.single.register import method
from unshutter_lab.methods.onnx import run_network


def identity(path: Path, rs: tuple[int, ...]) -> Path:
    """A network that gives back what it takes, named as rengarajan2017 does."""
    onnx = pytest.importorskip("onnx", reason="making networks for the tests needs onnx")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    nodes = [helper.make_node("Identity", ["rs"], ["key_rows"])]
    given = [helper.make_tensor_value_info("rs", kind, rs)]
    answers = [helper.make_tensor_value_info("key_rows", kind, [1, 3, 256, 256])]
    graph = helper.make_graph(nodes, "graph", given, answers)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


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


@pytest.mark.parametrize(
    ("rs", "told"),
    [
        ((1, 3, 256, 256), "they are not rengarajan2017 weights"),
        ((1, 3, 64, 64), "invalid dimensions"),
        ((1, 256), "Invalid rank"),
    ],
    ids=["another answer", "another size", "another rank"],
)
def test_a_file_of_another_network_is_told_in_one_line(
    rs: tuple, told: str, tmp_path: Path, photo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = identity(tmp_path / "odd.onnx", rs)
    assert main(["estimate", str(photo), "--estimator", f"rengarajan2017@{weights}"]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and f"cannot use the weights {weights}: " in message and told in message


@pytest.mark.parametrize(
    ("stand_in", "told"),
    [
        ("import os; os.abort()", "it makes its process crash"),
        ("import time; time.sleep(60)", "it took longer than 2 s"),
        ("bytearray(2**33)", "MemoryError"),
        ("import os; raise ImportError('telemetry off: ' + os.environ.get('ORT_DISABLE_TELEMETRY', 'no'))", "off: 1"),
    ],
    ids=["a crash", "no end", "no memory", "telemetry"],
)
def test_what_happens_in_the_process_of_the_network(
    stand_in: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the place of onnxruntime, which reads whether telemetry is off once, when it is loaded."""
    if "bytearray" in stand_in and sys.platform != "linux":
        pytest.skip("only Linux limits the memory of a process")
    monkeypatch.delenv("ORT_DISABLE_TELEMETRY")
    monkeypatch.setattr("unshutter.single.own_process.LONGEST_RUN_S", 2.0 if "sleep" in stand_in else 60.0)
    (tmp_path / "onnxruntime.py").write_text(stand_in)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UnshutterError, match=told):
        run_network("any", tmp_path / "any.onnx", np.zeros((1, 3, 8, 8), np.float32), "key_rows", (1, 3, 8, 8))


def test_weights_of_the_laboratory_itself_are_run() -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (80, 90, 3), dtype=np.uint8)
    for name in ("rengarajan2017", "rengarajan2017-vanilla", "kandula2020-research"):
        assert unshutter.estimate(pixels, estimator=name).estimator == name
