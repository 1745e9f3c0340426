"""kandula2020: the square in the middle of a photo, the network on it, and the photo's motion from the square's."""

import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.drawn_photos import drawn
from unshutter import Motion, RowMotion, UnshutterError, View
from unshutter.cli import main
from unshutter.errors import WeightsError
from unshutter.motion.warp import straighten
from unshutter.options import Camera
from unshutter.photo import Photo
from unshutter.single.own_process import run_in_own_process
from unshutter.single.register import method
from unshutter.single.row_network import (
    SIZE,
    Kandula2020,
    RowNetwork,
    as_input,
    corner_of,
    motion_of_square,
    side_of,
    square_of,
)

OURS = method("kandula2020")
EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_square_is_the_middle_of_the_readout_frame() -> None:
    pixels = np.zeros((SIZE, 400, 3), np.uint8)
    pixels[:, 72 : 72 + SIZE] = np.arange(SIZE, dtype=np.uint8)[:, None, None]  # brighter from row to row
    view = View(Photo.from_array(pixels))
    assert (side_of(view), corner_of(view)) == (SIZE, (72, 0))
    square = square_of(view)
    np.testing.assert_array_equal(square, pixels[:, 72 : 72 + SIZE])
    read = as_input(square)
    assert (read.shape, read.dtype) == ((1, 3, SIZE, SIZE), np.float32)
    np.testing.assert_allclose(read[0, 1], np.broadcast_to(np.arange(SIZE)[:, None] / 255, (SIZE, SIZE)))
    turned = square_of(View(Photo.from_array(pixels), Camera("bottom-to-top")))
    np.testing.assert_array_equal(turned, square[::-1, ::-1])


@pytest.mark.parametrize(("shape", "grey"), [((100, 300), 128 / 255), ((512, 300, 2), 128 / 255)])
def test_grey_photos_of_any_size_fill_it(shape: tuple[int, ...], grey: float) -> None:
    square = as_input(square_of(View(Photo.from_array(np.full(shape, 128, np.uint8)))))
    np.testing.assert_allclose(square, np.full((1, 3, SIZE, SIZE), grey), rtol=1e-6)


@pytest.mark.parametrize("degree", [None, 1])
def test_a_motion_goes_on_beyond_the_square(degree: int | None) -> None:
    """A photo twice as large and with 100 rows more at both ends: t_x doubles, slopes per row halve or stay."""
    view = View(Photo.from_array(np.zeros((712, 512), np.uint8)))
    rows = np.arange(0, SIZE, 18)
    motion = motion_of_square(view, rows, np.stack([0.1 * rows, 0.001 * rows]), degree)
    assert (motion.height, motion.width) == (712, 512)
    np.testing.assert_allclose(np.diff(motion.tx_px), 0.1, atol=1e-9)
    np.testing.assert_allclose(np.diff(motion.rz_rad), 0.0005, atol=1e-9)
    assert np.interp(100.5, np.arange(712), motion.tx_px) == pytest.approx(0)  # the middle of the square's first row


def test_the_motion_of_the_example_is_mostly_found() -> None:
    found = unshutter.estimate(EXAMPLES / "demo.jpg", estimator="kandula2020")
    truth = Motion.load(EXAMPLES / "demo.motion.json")
    assert (found.confidence, found.motion.tx_px[0], found.motion.rz_rad[0]) == (None, 0, 0)
    assert np.abs(found.motion.tx_px - truth.tx_px).mean() < 0.2 * np.abs(truth.tx_px).mean()


@pytest.mark.parametrize("shape", [(64, 64), (70, 90, 4), (300, 200, 1), (4000, 64, 3), (64, 5000, 3)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_photos_of_any_shape_and_type_get_an_answer(shape: tuple[int, ...], kind: type) -> None:
    pixels = np.random.default_rng(0).integers(0, np.iinfo(kind).max, shape, kind)
    found = unshutter.estimate(pixels, estimator="kandula2020")
    assert (found.motion.height, found.motion.width) == shape[:2]


def test_a_larger_photo_gets_a_larger_motion(rolling_facade: np.ndarray) -> None:
    side = min(rolling_facade.shape[:2])
    small = cv2.resize(rolling_facade[:side, :side], (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    photos = (small, small.repeat(20, 0).repeat(20, 1))
    motions = [unshutter.estimate(each, estimator="kandula2020").motion for each in photos]
    assert motions[1].largest_px == pytest.approx(20 * motions[0].largest_px, rel=0.15)


def test_an_enlarged_motion_is_a_cubic_within_the_square_and_straight_beyond(rolling_facade: np.ndarray) -> None:
    """Straight pieces between the network's rows made the warp of a large photo four times as slow."""
    square = cv2.resize(rolling_facade[:400, :400], (1000, 1000))
    found = unshutter.estimate(np.pad(square, ((100, 100), (0, 0), (0, 0))), estimator="kandula2020").motion
    for values in (found.tx_px, found.rz_rad):
        assert np.abs(np.diff(values[100:1100], 2)).max() > 1e-7
        np.testing.assert_allclose(np.diff(values[100:1100], 4), 0, atol=1e-9)
        np.testing.assert_allclose(np.diff(values[:100], 2), 0, atol=1e-9)
        np.testing.assert_allclose(np.diff(values[-100:], 2), 0, atol=1e-9)


class Scripted(RowNetwork):
    """Answers with these motions in turn, and keeps what it was shown."""

    def __init__(self, *motions: np.ndarray):
        self.motions = list(motions)
        self.shown: list[np.ndarray] = []

    def motion_of(self, square: np.ndarray) -> np.ndarray:
        self.shown.append(square)
        return self.motions.pop(0)


@pytest.mark.parametrize(("share", "counts"), [(0.49, True), (-0.49, True), (0.51, False)])
def test_a_second_answer_counts_if_it_is_small(share: float, counts: bool) -> None:
    rows = np.arange(SIZE)
    first = np.stack([0.05 * rows, 0.0002 * rows])
    estimator = Kandula2020(OURS, OURS.weights)
    estimator._network = network = Scripted(first, share * first)
    square = drawn(SIZE, SIZE)
    np.testing.assert_allclose(estimator.of_square(square), (1 + share if counts else 1) * first)
    np.testing.assert_array_equal(network.shown[0], square)
    np.testing.assert_array_equal(network.shown[1], straighten(square, RowMotion(SIZE, *first))[0])


def test_a_motion_that_would_fold_the_picture_is_not_looked_at_again() -> None:
    rows = np.arange(SIZE)
    first = np.stack([0.05 * rows, 0.1 * rows])
    estimator = Kandula2020(OURS, OURS.weights)
    estimator._network = Scripted(first)
    np.testing.assert_array_equal(estimator.of_square(drawn(SIZE, SIZE)), first)


def test_threads_share_a_network_and_leave_opencvs_alone() -> None:
    squares = [np.roll(drawn(SIZE, SIZE), 9 * k, 1) for k in range(6)]
    expected = [RowNetwork("kandula2020", OURS.weights).motion_of(square) for square in squares]
    assert not np.array_equal(expected[0], expected[1])
    before = cv2.getNumThreads()
    network = RowNetwork("kandula2020", OURS.weights)
    with ThreadPoolExecutor(4) as threads:
        for found, other in zip(threads.map(network.motion_of, squares * 3), expected * 3, strict=True):
            np.testing.assert_array_equal(found, other)
    assert cv2.getNumThreads() == before


def test_its_results_are_the_same_bytes_each_time(photo: Path, tmp_path: Path) -> None:
    outputs = [tmp_path / "a.png", tmp_path / "b.png"]
    for output in outputs:
        assert main(["rectify", str(photo), "--estimator", "kandula2020", "-o", str(output)]) == 0
    by_python = tmp_path / "c.png"
    unshutter.rectify(photo, estimator="kandula2020").save(by_python)
    assert len({path.read_bytes() for path in (*outputs, by_python)}) == 1
    assert outputs[0].read_bytes() != photo.read_bytes()


def test_it_needs_neither_onnxruntime_nor_weights_before_its_first_photo(photo: Path) -> None:
    program = (
        "import sys; sys.modules['onnxruntime'] = sys.modules['onnx'] = None\n"
        "import unshutter; estimator = unshutter.load('kandula2020')\n"
        "print(estimator._network._net)\n"
        "estimator.prepare(); print(type(estimator._network._net).__name__)\n"
        "print(unshutter.estimate(sys.argv[1], estimator=estimator).estimator)"
    )
    done = subprocess.run([sys.executable, "-c", program, photo], capture_output=True, text=True, check=False)
    assert (done.stdout.split(), done.stderr) == (["None", "Net", "kandula2020"], "")


# ---- files of one's own --------------------------------------------------------------------------------------


def test_a_copy_of_the_weights_does_the_same(tmp_path: Path, rolling_facade: np.ndarray) -> None:
    copy = tmp_path / "häuser.onnx"
    shutil.copy(str(OURS.weights), copy)
    found = unshutter.estimate(rolling_facade, estimator=f"kandula2020@{copy}")
    assert found == unshutter.estimate(rolling_facade, estimator="kandula2020")


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (lambda weights: weights[:100_000], "the file is damaged, or a network that OpenCV cannot run"),
        (lambda weights: b"", "the file is damaged, or a network that OpenCV cannot run"),
        (lambda weights: weights.replace(b"motion", b"vision"), "they are not kandula2020 weights"),
        (lambda weights: weights.replace(b"rs", b"sr"), "kandula2020 weights|damaged"),
    ],
)
def test_files_that_are_damaged_are_refused_in_one_line(
    damage, told: str, tmp_path: Path, photo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert OURS.weights is not None
    file = tmp_path / "odd.onnx"
    file.write_bytes(damage(OURS.weights.read_bytes()))
    output = tmp_path / "out.png"
    assert main(["rectify", str(photo), "--estimator", f"kandula2020@{file}", "-o", str(output)]) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and line.startswith(f"unshutter: cannot use the weights {file}: ")
    assert any(each in line for each in told.split("|")) and not output.exists()


def test_a_process_that_dies_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="it makes its process crash"):
        run_in_own_process("support.dying_network", tmp_path / "harmless.onnx")


def test_weights_that_are_gone_are_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(UnshutterError, match="needs the weights"):
        RowNetwork("kandula2020", None).open()
    with pytest.raises(UnshutterError, match=r"cannot read the weights .*gone\.onnx: No such file"):
        RowNetwork("kandula2020", tmp_path / "gone.onnx").open()
