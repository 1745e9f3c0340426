"""kandula2020: the paper's network on the central square of a photo -> t_x and r_z of every row. OpenCV runs it.

Rows beyond the square (tall photos) get the motion extrapolated by the last slope. The network looks at the square,
then at what it has rectified so far; what it finds then is added if it is small. Trained by ``unshutter_lab.training``;
the card next to the weights describes how.
"""

from __future__ import annotations

from pathlib import Path
from threading import Lock

import cv2
import numpy as np

from unshutter.errors import UnshutterError, WeightsError
from unshutter.motion import Motion, RowMotion
from unshutter.motion.opencv_threads import no_opencv_threads
from unshutter.motion.shapes import Float, Float32, Float64, UInt
from unshutter.motion.warp import straighten
from unshutter.single import Method
from unshutter.single.estimator import Estimator, View
from unshutter.single.own_process import answer, run_in_own_process

SIZE = 256  # px of the square


def square_of(view: View) -> UInt[np.ndarray, "256 256 3"]:
    """Returns the largest central square of the readout frame, RGB, of the photo's own type."""
    pixels = view.scan_direction.to_scan_frame(view.photo.to_array())
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    side = side_of(view)
    left, top = corner_of(view)
    pixels = np.ascontiguousarray(pixels[top : top + side, left : left + side, : 3 if pixels.shape[-1] > 2 else 1])
    how = cv2.INTER_AREA if side >= SIZE else cv2.INTER_LINEAR
    square = cv2.resize(pixels, (SIZE, SIZE), interpolation=how).reshape(SIZE, SIZE, -1)
    return np.ascontiguousarray(np.broadcast_to(square, (SIZE, SIZE, 3)))


def as_input(square: UInt[np.ndarray, "256 256 3"]) -> Float32[np.ndarray, "1 3 256 256"]:
    """Returns a square as networks read it: RGB in 0 ... 1."""
    scaled = square.astype(np.float32) / np.iinfo(square.dtype).max
    return np.ascontiguousarray(scaled.transpose(2, 0, 1)[None])


def motion_of_square(
    view: View,
    rows: Float[np.ndarray, "samples"],
    samples: Float[np.ndarray, "2 samples"],
    degree: int | None = None,
) -> RowMotion:
    """Returns the motion of the whole photo from samples (t_x [px of 256], r_z [rad]) at rows of its square.

    A polynomial of the degree is fitted; None interpolates linearly.
    """
    scale = side_of(view) / SIZE
    at = (rows + 0.5) * scale - 0.5 + corner_of(view)[1]
    return RowMotion.from_key_rows(
        rows=at.tolist(),
        tx_px=(samples[0] * scale).tolist(),
        rz_rad=samples[1].tolist(),
        height=view.height,
        width=view.width,
        degree=degree,
        scan_direction=view.scan_direction,
    )


def side_of(view: View) -> int:
    """Number of rows and columns of the photo within the square [px]."""
    return min(view.height, view.width)


def corner_of(view: View) -> tuple[int, int]:
    """(left, top) of the square in the photo [px]."""
    return (view.width - side_of(view)) // 2, (view.height - side_of(view)) // 2


class RowNetwork:
    """A network in a file (ONNX), which is read when first needed. Thread-safe."""

    def __init__(self, name: str, file: Path | None):
        self._name = name
        self._file = file
        self._net: cv2.dnn.Net | None = None
        self._using = Lock()  # it holds its input and answer

    def open(self) -> None:
        """Reads the file the first time.

        Raises:
            WeightsError: it cannot be used.
        """
        with self._using:
            self._opened()

    def motion_of(self, square: UInt[np.ndarray, "256 256 3"]) -> Float64[np.ndarray, "2 256"]:
        """Returns t_x [px of 256] and r_z [rad] of every row of a square.

        Raises:
            WeightsError: the file cannot be used.
        """
        with self._using, no_opencv_threads():
            net = self._opened()
            try:
                net.setInput(as_input(square), "rs")
                motion = net.forward("motion").astype(np.float64)  # a copy
            except cv2.error:
                raise self._refusal(f"they are not {self._name} weights") from None
        if motion.shape != (1, 2, SIZE):
            raise self._refusal(f"they are not {self._name} weights")
        if not np.isfinite(motion).all():
            raise self._refusal("their answer is not a number")
        return motion[0]

    def _opened(self) -> cv2.dnn.Net:
        if self._net is None:
            self._net = self._read()
        return self._net

    def _read(self) -> cv2.dnn.Net:
        if self._file is None:
            raise WeightsError(f"{self._name} needs the weights of a network")
        try:
            data = self._file.read_bytes()  # by us: OpenCV does not open every name
        except OSError as error:
            raise WeightsError(f"cannot read the weights {self._file}: {error.strerror or error}") from None
        try:
            return cv2.dnn.readNetFromONNX(np.frombuffer(data, np.uint8))
        except cv2.error:
            raise self._refusal("the file is damaged, or a network that OpenCV cannot run") from None

    def _refusal(self, why: str) -> WeightsError:
        return WeightsError(f"cannot use the weights {self._file}: {why}")


def motion_in_grey(network: RowNetwork, view: View, grey: UInt[np.ndarray, "h w"]) -> Motion:
    """Returns the motion that a network sees at a first look at the photo's grey copy; first row as the reference."""
    side = min(grey.shape)
    top, left = (grey.shape[0] - side) // 2, (grey.shape[1] - side) // 2
    how = cv2.INTER_AREA if side >= SIZE else cv2.INTER_LINEAR
    square = cv2.resize(
        np.ascontiguousarray(grey[top : top + side, left : left + side]), (SIZE, SIZE), interpolation=how
    )
    return _enlarged(view, network.motion_of(np.repeat(square[..., None], 3, axis=2)))


def _enlarged(view: View, motion: Float64[np.ndarray, "2 256"]) -> Motion:
    """Returns the motion of the photo from that of its square."""
    rows = (np.arange(side_of(view)) + 0.5) * SIZE / side_of(view) - 0.5  # the photo's, in rows of the square
    return motion_of_square(view, rows, cubic(motion, rows)).rereferenced("first")


_UNITS = np.array([[100.0], [1.0]])  # px and rad that weigh alike


class Kandula2020(Estimator):
    """kandula2020: the answer of the network. It has no confidence, and never declines."""

    def __init__(self, method: Method, weights: Path | None = None):
        super().__init__(method, weights)
        self._network = RowNetwork(method.name, weights)

    def prepare(self) -> None:
        """Opens the network; one of the user's, whose file may be anything, runs in a process of its own first."""
        if self.weights is not None and self.weights != self.method.weights:
            run_in_own_process("unshutter.single.row_network", self.weights, self.name)
        self._network.open()

    def estimate(self, view: View) -> Motion:
        """Returns cubic t_x and r_z, enlarged to the photo; first row as the reference."""
        return _enlarged(view, self.of_square(square_of(view)))

    def of_square(self, square: UInt[np.ndarray, "256 256 3"]) -> Float64[np.ndarray, "2 256"]:
        """Returns t_x [px of 256] and r_z [rad] of every row of a square, after the second look."""
        first = self._network.motion_of(square)
        try:
            rectified = straighten(square, RowMotion(SIZE, first[0], first[1]))[0]
        except UnshutterError:  # it would fold
            return first
        second = self._network.motion_of(rectified)
        # A second look at what is nearly right finds little. Where it finds more than this share of the first answer,
        # neither can be trusted, and nothing is added.
        return first + second if _size(second) < 0.5 * _size(first) else first


def cubic(motion: Float64[np.ndarray, "2 256"], rows: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "2 rows"]:
    """Interpolates a motion by cubics at other rows; warping by straight pieces would be slow."""
    coefficients = np.polynomial.polynomial.polyfit(np.arange(SIZE) / SIZE, motion.T, 3)
    return np.polynomial.polynomial.polyval(rows / SIZE, coefficients)


def _size(motion: Float64[np.ndarray, "2 rows"]) -> float:
    return float(np.sqrt(np.square(motion / _UNITS).sum(0).mean()))


def _try_out(weights: Path, name: str) -> bytes:
    """Runs a network once."""
    RowNetwork(name, weights).motion_of(np.random.default_rng(0).integers(0, 256, (SIZE, SIZE, 3), np.uint8))
    return b""


if __name__ == "__main__":
    answer(_try_out)
