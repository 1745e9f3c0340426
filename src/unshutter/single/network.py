"""The small transformer that estimates row motion from line segments, used by several methods.

Trained by ``unshutter_lab.training`` on drawn scenes; the card next to the weights describes how. The input features
are written once for NumPy (inference) and torch (training); the network in NumPy equals the trained one to about 1e-6.

Shapes in comments: N segments, d numbers each (96 in the shipped network). The picture and its mirror image have one
thread each; matrices are multiplied in pieces small enough for OpenBLAS not to start threads of its own, which spin
while they wait for each other and took ten times as long on a busy machine.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock

import numpy as np

from unshutter import version
from unshutter.errors import WeightsError
from unshutter.motion import geometry
from unshutter.motion.shapes import Array, Float

Weights = dict[str, np.ndarray]
FEATURES = 39  # numbers per segment


def undo_motion(tokens: Float[Array, "batch segments 6"], motion: Float[Array, "batch 2 3"]) -> Array:
    """Returns the end points as a global shutter would have seen them, given the motion (Eq. 1).

    Args:
        tokens: end points x1, y1, x2, y2 [rows, centred], and the unit vector towards the top of the scene.
        motion: coefficients of u, u^2, u^3 with u = y + 1/2: t_x [rows], r_z [rad].

    Returns:
        x and y of both ends [batch, 2 (x, y), segments, 2 (ends)].
    """
    xp = geometry.namespace(tokens)
    x, y = tokens[..., 0:4:2], tokens[..., 1:4:2]  # [B, N, 2 ends]
    u = y + 0.5
    tx, rz = (u * geometry.polynomial(motion[:, k, None, None], u) for k in (0, 1))
    return xp.stack(geometry.rs_to_gs(x, y, tx, rz), axis=1)


def features(tokens: Float[Array, "batch segments 6"], ends: Float[Array, "batch 2 segments 2"]) -> Array:
    """Returns features [batch, segments, FEATURES]; they do not depend on the order of the ends."""
    xp = geometry.namespace(tokens)
    x, y = ends[:, 0], ends[:, 1]  # [B, N, 2 ends]
    middle_x, middle_y = (x[..., 0] + x[..., 1]) / 2, (y[..., 0] + y[..., 1]) / 2  # [B, N] from here on
    step_x = x[..., 1] - x[..., 0]
    step_y = y[..., 1] - y[..., 0]
    length = xp.sqrt(xp.clip(step_x * step_x + step_y * step_y, 1e-12, None))
    cos = step_x / length
    sin = step_y / length
    # double angles and deviations from vertical and horizontal do not change when the ends are swapped
    angles = [cos * cos - sin * sin, 2 * sin * cos]
    for _ in range(4):  # 4, 8, 16, 32 times the angle
        c = angles[-2]
        s = angles[-1]
        angles += [c * c - s * s, 2 * s * c]
    lean = cos * xp.sign(sin + 1e-9)
    rise = sin * xp.sign(cos + 1e-9)
    fine = [xp.tanh(k * deviation) for deviation in (lean, rise) for k in (6.0, 25.0)]  # from vertical, and from level
    waves = []
    for k in range(4):  # octaves
        for position in (middle_x, middle_y):
            phase = (2 * math.pi * 2.0**k / 4) * position
            waves += [xp.sin(phase), xp.cos(phase)]
    size = length + 0.02
    first, second = tokens[..., 1], tokens[..., 3]  # the rows of both ends, i.e. the times at which they were read
    columns = [
        *(middle_x, middle_y, xp.abs(step_x) / size, xp.abs(step_y) / size, xp.log(length) + 3),
        *angles,
        *fine,
        *waves,
        *(xp.minimum(first, second), xp.maximum(first, second), tokens[..., 4], tokens[..., 5]),
    ]
    return xp.stack(columns, axis=-1)


# t_x [rows] and r_z [rad] per unit of the head's output; and its basis, the shifted Legendre polynomials of degree
# 1 to 3 minus their value at u = 0, in powers of u
_UNITS = np.array([[0.1], [0.06]], np.float32)
_LEGENDRE = np.array([[2, 0, 0], [-6, 6, 0], [12, -30, 20]], np.float32)

# erf(x / sqrt 2) = tanh(x p(x^2)): least squares over 0 <= x <= 5.6, reweighted to minimise the largest error of
# x erf: 1.3e-7. Beyond 5.6, where erf is 1 in float32, p grows without bound, so tanh is 1 too.
_ERF = (0.797884217, 0.0363342819, -3.31287717e-05, -5.52405210e-05, 3.96915859e-06, -1.33449421e-07, 1.80568339e-09)
_AT_A_TIME = 32_768  # numbers per block, so that all steps of gelu stay in the processor's cache

_ON_ONE_THREAD = 2**19 - 1  # most multiplications per call for which OpenBLAS starts no threads

_NAME = "segment-transformer"
_silent = np.errstate(all="ignore")  # in each thread; the caller checks whether the output is finite


class SegmentNetwork:
    """The network with its weights, which are read when first needed. Thread-safe."""

    def __init__(self, file: Path | None):
        self._file = file
        self._weights: Weights = {}
        self._opening = Lock()

    def open(self) -> None:
        """Reads the weights the first time."""
        with self._opening:
            self._weights = self._weights or read_weights(self._file)

    def coefficients(
        self, segments: Float[np.ndarray, "segments 4"], up: tuple[int, int] = (0, -1)
    ) -> Float[np.ndarray, "2 3"]:
        """Estimates the motion from [N, 4] end points x1, y1, x2, y2 [rows, centred].

        Args:
            up: unit vector (right, down) towards the top of the scene.

        Returns:
            [2, 3] coefficients of u, u^2, u^3 with u = (row + 1/2) / rows: t_x [rows], r_z [rad].
        """
        tokens = np.concatenate([segments, np.broadcast_to(np.asarray(up), (len(segments), 2))], axis=1)
        found = self.of_tokens(tokens.astype(np.float32))
        if not np.isfinite(found).all():
            raise WeightsError(f"cannot use the weights {self._file}: their answer is not a number")
        return found.astype(np.float64)

    @_silent
    def of_tokens(self, tokens: Float[np.ndarray, "segments 6"]) -> Float[np.ndarray, "2 3"]:
        """Returns the coefficients for float32 tokens, see :func:`moved`.

        Each iteration rectifies the segments by the current motion and estimates the remaining one. It does so for the
        picture and its mirror image, in which t_x and r_z have the opposite sign, and takes the average.
        """
        self.open()
        motion = np.zeros((2, 3), np.float32)
        mirrored_tokens = tokens * np.array([-1, 1, -1, 1, -1, 1], np.float32)
        with ThreadPoolExecutor(1) as thread:
            for _ in range(int(self._weights["iterations"])):
                mirrored = thread.submit(self._correction, mirrored_tokens, -motion)
                motion = motion + (self._correction(tokens, motion) - mirrored.result()) / 2
        return motion

    @_silent
    def _correction(self, tokens: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """Returns the correction to the motion [2, 3], with the same shape."""
        batch = tokens[None]
        x = features(batch, undo_motion(batch, motion[None]))[0]  # [N, FEATURES]
        x = self._linear("embedding.output", gelu(self._linear("embedding.hidden", x)))  # [N, d]
        for k in range(len(self._weights["blocks.attention.query.weight"])):
            y = self._norm("blocks.attention.norm", x, k)
            x += self._attention("blocks.attention", y, y, k)
            y = self._norm("blocks.mlp.norm", x, k)
            x += self._linear("blocks.mlp.output", gelu(self._linear("blocks.mlp.hidden", y, k)), k)
        latents = self._weights["pooling.latents"]  # [latents, d]
        pooled = self._attention("pooling", latents, self._norm("pooling.norm", x))  # [latents, d]
        y = self._norm("head.norm", pooled.reshape(1, -1))  # [1, latents d]
        y = self._linear("head.output", gelu(self._linear("head.hidden", y)))  # [1, OUTPUTS]
        return (y[0, :6].reshape(2, 3) * _UNITS) @ _LEGENDRE

    def _of(self, name: str, layer: int | None) -> np.ndarray:
        array = self._weights[name]
        return array if layer is None else array[layer]

    def _linear(self, name: str, x: np.ndarray, layer: int | None = None) -> np.ndarray:
        weight = self._of(f"{name}.weight", layer)
        y = np.empty((len(x), weight.shape[1]), np.float32)
        _multiply(x, weight, y)
        y += self._of(f"{name}.bias", layer)
        return y

    def _norm(self, name: str, x: np.ndarray, layer: int | None = None) -> np.ndarray:
        """Normalises each row to mean 0 and variance 1, then scales and shifts it."""
        y = x - x.mean(-1, keepdims=True)
        variance = np.einsum("...d,...d->...", y, y)[..., None] / x.shape[-1]
        y /= np.sqrt(variance + 1e-5)
        y *= self._of(f"{name}.scale", layer)
        y += self._of(f"{name}.shift", layer)
        return y

    def _attention(self, name: str, asking: np.ndarray, context: np.ndarray, layer: int | None = None) -> np.ndarray:
        """Computes for each row of ``asking`` [M, d] its attention-weighted sum of values from ``context`` [N, d].

        One head at a time, so that its scores [M, N] fit into the processor's cache.
        """
        query = self._linear(f"{name}.query", asking, layer)  # [M, d]
        keys_values = self._linear(f"{name}.key_value", context, layer)  # [N, 2 d]
        width = query.shape[1]
        size = width // int(self._weights["heads"])
        query *= 1 / math.sqrt(size)
        answer = np.empty_like(query)
        scores = np.empty((len(asking), len(context)), np.float32)  # [M, N]
        for start in range(0, width, size):
            of_head = slice(start, start + size)
            of_value = slice(width + start, width + start + size)
            _exp_scores(query[:, of_head], keys_values[:, of_head], scores)
            values = answer[:, of_head]  # [M, size]
            _multiply(scores, keys_values[:, of_value], values)
            values /= scores.sum(-1, keepdims=True)
        return self._linear(f"{name}.output", answer, layer)


def _multiply(a: np.ndarray, b: np.ndarray, product: np.ndarray) -> None:
    """Fills product [M, n] with a [M, k] @ b [k, n], a few rows at a time."""
    rows, inner = a.shape
    columns = b.shape[1]
    step = max(_ON_ONE_THREAD // (inner * columns), 1)
    whole = rows - rows % step
    if whole:
        np.matmul(a[:whole].reshape(-1, step, inner), b, out=product[:whole].reshape(-1, step, columns))
    if whole < rows:
        np.matmul(a[whole:], b, out=product[whole:])


def _exp_scores(query: np.ndarray, key: np.ndarray, scores: np.ndarray) -> None:
    """Fills scores [M, N] with exp(query . key) of query [M, size] and key [N, size].

    If that could overflow, each row is multiplied by a common factor.
    """
    _multiply(query, key.T, scores)
    largest = math.sqrt(np.square(query).sum(-1).max() * np.square(key).sum(-1).max())  # upper bound
    if not largest < 80.0:  # its exp is far below the largest float32
        scores -= scores.max(-1, keepdims=True)
    np.exp(scores, out=scores)


def gelu(x: np.ndarray) -> np.ndarray:
    """Computes x (1 + erf(x / sqrt 2)) / 2, in place (NumPy has no erf). x must be contiguous."""
    flat = x.reshape(-1)
    for start in range(0, flat.size, _AT_A_TIME):
        part = flat[start : start + _AT_A_TIME]
        square = part * part
        p = square * _ERF[-1]
        for coefficient in _ERF[-2:0:-1]:
            p += coefficient
            p *= square
        p += _ERF[0]
        p *= part
        np.tanh(p, out=p)
        p += 1
        p *= 0.5
        part *= p
    return x


OUTPUTS = 6 + 3  # coefficients of the motion, and the camera's pose, which only training uses
_COUNTS = ("heads", "iterations")  # whole numbers among the arrays


def shapes(width: int, layers: int, latents: int) -> dict[str, tuple[int, ...]]:
    """Returns name and shape of all arrays; ``x @ weight + bias`` is a linear layer, ``blocks`` are stacked."""
    d = width
    k = layers
    return {
        **_linear("embedding.hidden", FEATURES, d),
        **_linear("embedding.output", d, d),
        **_norm("blocks.attention.norm", k, d),
        **_linear("blocks.attention.query", k, d, d),
        **_linear("blocks.attention.key_value", k, d, 2 * d),
        **_linear("blocks.attention.output", k, d, d),
        **_norm("blocks.mlp.norm", k, d),
        **_linear("blocks.mlp.hidden", k, d, 2 * d),
        **_linear("blocks.mlp.output", k, 2 * d, d),
        "pooling.latents": (latents, d),
        **_norm("pooling.norm", d),
        **_linear("pooling.query", d, d),
        **_linear("pooling.key_value", d, 2 * d),
        **_linear("pooling.output", d, d),
        **_norm("head.norm", latents * d),
        **_linear("head.hidden", latents * d, 2 * d),
        **_linear("head.output", 2 * d, OUTPUTS),
    }


def _linear(name: str, *shape: int) -> dict[str, tuple[int, ...]]:
    return {f"{name}.weight": shape, f"{name}.bias": (*shape[:-2], shape[-1])}


def _norm(name: str, *shape: int) -> dict[str, tuple[int, ...]]:
    return {f"{name}.scale": shape, f"{name}.shift": shape}


def read_weights(path: Path | None) -> Weights:
    """Returns the arrays of a file, float32, and the counts ``heads`` and ``iterations``."""
    if path is None:
        raise WeightsError(f"{_NAME} needs the weights of a network")
    if path.suffix == ".onnx":
        raise WeightsError(
            f"cannot use the weights {path}: {_NAME} needs an .npz file, which training writes next to "
            f"its checkpoint ({version.lab('train')})"
        )
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > 64_000_000:  # of a file's arrays; ours takes 1.7 million
            raise WeightsError(f"cannot use the weights {path}: {size / 1e6:.0f} MB are too many for {_NAME}")
        with np.load(path, allow_pickle=False) as stored:
            weights = {each: np.asarray(stored[each]) for each in stored.files}
    except OSError as error:
        raise WeightsError(f"cannot read the weights {path}: {error.strerror or error}") from None
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, RuntimeError, MemoryError, SyntaxError):
        # RuntimeError: encrypted, or an unknown compression; SyntaxError: a header that is not valid Python
        raise WeightsError(f"cannot use the weights {path}: the file is damaged, or not an .npz of NumPy") from None
    if not _is_complete(weights):
        raise WeightsError(f"cannot use the weights {path}: they are not {_NAME} weights")
    return {each: array if each in _COUNTS else array.astype(np.float32) for each, array in weights.items()}


def write_weights(path: Path, weights: Weights) -> None:
    """Writes a file for :func:`read_weights`; equal weights give identical files."""
    if not _is_complete(weights):
        raise ValueError("these arrays are not the weights of a segment transformer")
    part = path.with_name(f"{path.name}.part")
    with open(part, "wb") as stream:
        np.savez(stream, **weights)  # pyright: ignore[reportArgumentType]
    part.replace(path)


def _is_complete(weights: Weights) -> bool:
    """Whether names, shapes, data types and counts are those of this network."""
    latents = weights.get("pooling.latents")
    queries = weights.get("blocks.attention.query.weight")
    if latents is None or queries is None or latents.ndim != 2 or queries.ndim != 3 or 0 in latents.shape:
        return False
    width = latents.shape[1]
    expected = {**dict.fromkeys(_COUNTS, ()), **shapes(width, len(queries), len(latents))}
    if {name: array.shape for name, array in weights.items()} != expected:
        return False
    if any(array.dtype.kind != ("i" if name in _COUNTS else "f") for name, array in weights.items()):
        return False
    heads, iterations = (int(weights[name]) for name in _COUNTS)
    return 1 <= heads <= 64 and width % heads == 0 and 1 <= iterations <= 16
