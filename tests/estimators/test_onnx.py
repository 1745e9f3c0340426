"""Files of networks: opened, run, refused in one line."""

import gc
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.networks import crash_at_running, identity, integer, made, square_only
from unshutter import installation
from unshutter.cli import main
from unshutter.estimators.onnx import Network, open_network
from unshutter.estimators.register import method
from unshutter.photo import Photo


@pytest.mark.parametrize("name", ["segment-transformer", "segment-manhattan", "kandula2020", "rengarajan2017"])
def test_weights_that_are_none_are_told_in_one_line(
    name: str, tmp_path: Path, rolling_facade: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, text = tmp_path / "photo.png", tmp_path / "text.onnx"
    Photo.from_array(rolling_facade).save(photo)
    text.write_text("no network")
    learned = "20" in name
    other = made(tmp_path / "other.onnx", identity, square_only) if learned else method("kandula2020").weights
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
        (identity, (1, 3, 256, 256), "they are not of rengarajan2017"),
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
def test_a_network_without_an_end_is_ended_at_the_limit(
    nodes, tmp_path: Path, rolling_facade: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = made(tmp_path / "long.onnx", nodes, square_only)
    estimator = unshutter.load(f"rengarajan2017@{weights}")
    monkeypatch.setattr("unshutter.estimators.onnx.LONGEST_RUN_S", 0.5)
    start = time.monotonic()
    with pytest.raises(unshutter.UnshutterError, match=r"it was not done after 0\.5 s"):
        unshutter.estimate(rolling_facade, estimator=estimator)
    assert time.monotonic() - start < 6


def test_a_photo_is_not_tried_twice_with_a_network_without_an_end(
    tmp_path: Path, photo: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("unshutter.estimators.onnx.LONGEST_RUN_S", 2.0)
    asked = []
    run = Network.answers
    monkeypatch.setattr(Network, "answers", lambda *given: asked.append(given) or run(*given))
    weights = made(tmp_path / "endless.onnx", endless, square_only)
    assert main(["estimate", str(photo), "--estimator", f"rengarajan2017@{weights}"]) == 1
    assert "it was not done after 2 s" in capsys.readouterr().err
    assert len(asked) == 1


def test_after_a_crash_the_next_photo_is_tried(tmp_path: Path) -> None:
    weights = made(tmp_path / "sometimes.onnx", crash_at_running, square_only)
    network = open_network("any", weights, ["rs"], "key_rows")
    dark, bright = (np.full((1, 3, 256, 256), value, np.float32) for value in (0, 3))
    for _ in range(2):
        with pytest.raises(unshutter.UnshutterError, match="crash"):
            network.answers({"rs": dark}, dark.shape)
        assert (network.answers({"rs": bright}, bright.shape)[0] == 3 * (-(2**31) // 2)).all()


def test_workers_run_networks_and_outlive_a_crash(
    tmp_path: Path, photo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for name in ("a.jpg", "b.jpg"):
        (folder / name).write_bytes(photo.read_bytes())
    weights = made(tmp_path / "crashing.onnx", crash_at_running, square_only)
    words = ["rectify", str(folder), "-o", str(tmp_path / "out"), "--jobs", "2", "--estimator"]
    assert main([*words, f"rengarajan2017@{weights}"]) == 1
    lines = [line for line in capsys.readouterr().err.splitlines() if "cannot use the weights" in line]
    assert len(lines) == 2 and all(line.endswith("it makes its process crash") for line in lines)
    assert main([*words, "rengarajan2017"]) == 0


def test_one_process_serves_all_photos_and_threads_and_ends_with_its_network(tmp_path: Path) -> None:
    weights = made(tmp_path / "identity.onnx", identity, square_only)
    network = open_network("any", weights, ["rs"], "key_rows")
    process = network._runner._process
    given = [np.full((1, 3, 256, 256), k, np.float32) for k in range(12)]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda rs, asked=network: asked.answers({"rs": rs}, rs.shape)[0], given))
    for rs, answer in zip(given, found, strict=True):
        np.testing.assert_array_equal(answer, rs)
    assert network._runner._process is process and process.poll() is None
    del network
    gc.collect()
    assert process.poll() is not None


ABANDONED = """
import os, sys
from pathlib import Path
from unshutter.estimators.onnx import open_network
network = open_network("any", Path(sys.argv[1]), ["rs"], "key_rows")
print(network._runner._process.pid, flush=True)
os.kill(os.getpid(), 9)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="looks at processes as POSIX has them")
def test_it_ends_when_who_asked_was_killed(tmp_path: Path) -> None:
    weights = made(tmp_path / "identity.onnx", identity, square_only)
    done = subprocess.run([sys.executable, "-c", ABANDONED, weights], stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == -9
    for _ in range(100):
        try:
            os.kill(int(done.stdout), 0)
        except ProcessLookupError:
            return
        with suppress(OSError):  # ended, but not yet waited for by whoever adopted it
            if ") Z " in Path(f"/proc/{int(done.stdout)}/stat").read_text():
                return
        time.sleep(0.05)
    pytest.fail("it still runs")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork:DeprecationWarning")
def test_a_forked_process_has_its_own(tmp_path: Path) -> None:
    weights = made(tmp_path / "identity.onnx", identity, square_only)
    network = open_network("any", weights, ["rs"], "key_rows")
    rs = np.ones((1, 3, 256, 256), np.float32)
    child = os.fork()
    if child == 0:
        try:
            os._exit(0 if (network.answers({"rs": rs}, rs.shape)[0] == 1).all() else 1)
        finally:
            os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert (network.answers({"rs": rs}, rs.shape)[0] == 1).all()


@pytest.mark.parametrize("name", ["segment-manhattan", "kandula2020"])
def test_without_onnxruntime_it_says_what_to_install(
    name: str, tmp_path: Path, photo: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = made(tmp_path / "identity.onnx", identity, square_only)
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert main(["estimate", str(photo), "--estimator", f"{name}@{weights}"]) == 1
    message = capsys.readouterr().err
    assert message == f"unshutter: networks in ONNX files need the extra: {installation.extra('onnx')}\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_an_estimate_onto_a_full_disc_is_told_in_one_line(tmp_path: Path, rolling_facade: np.ndarray) -> None:
    photo = tmp_path / "photo.png"
    Photo.from_array(np.kron(rolling_facade, np.ones((4, 1, 1), np.uint8))).save(photo)
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "unshutter", "estimate", str(photo), "--estimator", "none"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith("No space left on device") and "unexpected" not in done.stderr
