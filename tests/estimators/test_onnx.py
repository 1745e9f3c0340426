"""Files of networks: opened, run, refused in one line."""

import subprocess
import sys
import time
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from support.networks import identity, made, square_only
from unshutter.cli import main
from unshutter.photo import Photo


@pytest.mark.parametrize("name", ["segment-transformer", "segment-manhattan", "kandula2020", "rengarajan2017"])
def test_weights_that_are_none_are_told_in_one_line(
    name: str, tmp_path: Path, rolling_facade: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, text = tmp_path / "photo.png", tmp_path / "text.onnx"
    Photo.from_array(rolling_facade).save(photo)
    text.write_text("no network")
    other = files("unshutter") / "weights" / ("segment-transformer.onnx" if "20" in name else "kandula2020.onnx")
    for command in (["rectify", str(photo), "-o", str(tmp_path / "out.png")], ["estimate", str(photo)]):
        for weights, told in ((text, "PROTOBUF"), (other, "they are not of")):
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


@pytest.mark.parametrize(
    ("nodes", "rs", "told"),
    [
        (identity, (1, 3, 256, 256), "they are not of rengarajan2017"),
        (identity, (1, 3, 64, 64), "invalid dimensions"),
        (identity, (1, 256), "Invalid rank"),
        (endless, (1, 3, 256, 256), "it was not done after 0.5 s"),
    ],
    ids=["another answer", "another size", "another rank", "a loop without an end"],
)
def test_a_file_of_another_network_is_told_in_one_line(
    nodes, rs: tuple, told: str, tmp_path: Path, rolling_facade: np.ndarray, capsys, monkeypatch
) -> None:
    monkeypatch.setattr("unshutter.estimators.onnx.LONGEST_RUN_S", 0.5)
    photo = tmp_path / "photo.png"
    Photo.from_array(rolling_facade).save(photo)
    weights = made(tmp_path / "odd.onnx", nodes, square_only, rs)
    start = time.monotonic()
    assert main(["estimate", str(photo), "--estimator", f"rengarajan2017@{weights}"]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and f"cannot use the weights {weights}: " in message and told in message
    assert time.monotonic() - start < 20


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_an_estimate_onto_a_full_disc_is_told_in_one_line(tmp_path: Path, rolling_facade: np.ndarray) -> None:
    photo = tmp_path / "photo.png"
    Photo.from_array(np.kron(rolling_facade, np.ones((4, 1, 1), np.uint8))).save(photo)
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "unshutter", "estimate", str(photo), "--estimator", "none"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith("No space left on device") and "unexpected" not in done.stderr
