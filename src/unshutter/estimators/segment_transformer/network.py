"""The segment transformer in NumPy; its output equals that of the trained network (torch) to about 1e-6.

Shapes in comments: N segments, d numbers each (96 in the shipped network). The picture and its mirror image have one
thread each; matrices are multiplied in pieces small enough for OpenBLAS not to start threads of its own, which spin
while they wait for each other and took ten times as long on a busy machine.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from unshutter.estimators.segment_transformer.features import features, moved
from unshutter.estimators.segment_transformer.weights import Weights

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float

# t_x [rows] and r_z [rad] per unit of the head's output; and its basis, the shifted Legendre polynomials of degree
# 1 to 3 minus their value at u = 0, in powers of u
_UNITS = np.array([[0.1], [0.06]], np.float32)
_LEGENDRE = np.array([[2, 0, 0], [-6, 6, 0], [12, -30, 20]], np.float32)
_MIRROR = np.array([-1, 1, -1, 1, -1, 1], np.float32)  # mirrors a segment

# erf(x / sqrt 2) = tanh(x p(x^2)): least squares over 0 <= x <= 5.6, reweighted to minimise the largest error of
# x erf: 1.3e-7. Beyond 5.6, where erf is 1 in float32, p grows without bound, so tanh is 1 too.
_ERF = (0.797884217, 0.0363342819, -3.31287717e-05, -5.52405210e-05, 3.96915859e-06, -1.33449421e-07, 1.80568339e-09)
_AT_A_TIME = 32_768  # numbers per block, so that all steps of gelu stay in the processor's cache

_ON_ONE_THREAD = 2**19 - 1  # most multiplications per call for which OpenBLAS starts no threads
_LARGEST_EXPONENT = 80.0  # its exp is far below the largest float32

_silent = np.errstate(all="ignore")  # in each thread; the caller checks whether the output is finite


class SegmentTransformer:
    """Estimates row motion from line segments. Thread-safe.

    Args:
        weights: as ``read_weights`` returns them.
    """

    def __init__(self, weights: Weights):
        self._weights = weights
        self._layers = len(weights["blocks.attention.query.weight"])
        self._heads, self._iterations = int(weights["heads"]), int(weights["iterations"])

    @_silent
    def coefficients(self, tokens: Float[np.ndarray, "segments 6"]) -> Float[np.ndarray, "2 3"]:
        """Returns coefficients of u, u^2, u^3 with u = (row + 1/2) / rows: t_x [rows], r_z [rad].

        Each iteration rectifies the segments by the current motion and estimates the remaining one. It does so for the
        picture and its mirror image, in which t_x and r_z have the opposite sign, and takes the average.

        Args:
            tokens: float32: end points x1, y1, x2, y2 [rows, centred], and the unit vector towards the scene's top.
        """
        motion = np.zeros((2, 3), np.float32)
        with ThreadPoolExecutor(1) as thread:
            for _ in range(self._iterations):
                mirrored = thread.submit(self._correction, tokens * _MIRROR, -motion)
                motion = motion + (self._correction(tokens, motion) - mirrored.result()) / 2
        return motion

    @_silent
    def _correction(self, tokens: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """Returns the correction to the motion [2, 3], with the same shape."""
        batch = tokens[None]
        x = features(batch, moved(batch, motion[None]))[0]  # [N, FEATURES]
        x = self._linear("embedding.output", gelu(self._linear("embedding.hidden", x)))  # [N, d]
        for k in range(self._layers):
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
        size = width // self._heads
        query *= 1 / math.sqrt(size)
        answer = np.empty_like(query)
        scores = np.empty((len(asking), len(context)), np.float32)  # [M, N]
        for start in range(0, width, size):
            of_head, of_value = slice(start, start + size), slice(width + start, width + start + size)
            _exp_scores(query[:, of_head], keys_values[:, of_head], scores)
            values = answer[:, of_head]  # [M, size]
            _multiply(scores, keys_values[:, of_value], values)
            values /= scores.sum(-1, keepdims=True)
        return self._linear(f"{name}.output", answer, layer)


def _multiply(a: np.ndarray, b: np.ndarray, product: np.ndarray) -> None:
    """Fills product [M, n] with a [M, k] @ b [k, n], a few rows at a time."""
    (rows, inner), columns = a.shape, b.shape[1]
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
    if not largest < _LARGEST_EXPONENT:
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
