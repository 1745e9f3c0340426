"""The file of the network's weights: a NumPy .npz whose arrays have the names and shapes given by :func:`shapes`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unshutter.errors import WeightsError
from unshutter.estimators.segment_transformer.features import FEATURES

OUTPUTS = 6 + 3  # coefficients of the motion, and the camera's pose, which only training uses
LARGEST_BYTES = 64_000_000  # of a file's arrays; ours takes 1.7 million
_MOST_ITERATIONS, _MOST_HEADS = 16, 64
_COUNTS = ("heads", "iterations")  # whole numbers among the arrays

Weights = dict[str, np.ndarray]


def shapes(width: int, layers: int, latents: int) -> dict[str, tuple[int, ...]]:
    """Returns name and shape of all arrays; ``x @ weight + bias`` is a linear layer, ``blocks`` are stacked.

    Args:
        width: numbers per segment inside the network.
        layers: transformer blocks.
        latents: learned queries that pool the segments' information.
    """
    d, k = width, layers
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


def read_weights(path: Path, name: str) -> Weights:
    """Returns the arrays of a file, float32, and the counts ``heads`` and ``iterations``.

    Args:
        path: the file.
        name: name of the estimator, for messages.

    Raises:
        WeightsError: the file cannot be read, or does not hold this network.
    """
    import zipfile
    import zlib

    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > LARGEST_BYTES:
            raise WeightsError(f"cannot use the weights {path}: {size / 1e6:.0f} MB are too many for {name}")
        with np.load(path, allow_pickle=False) as stored:
            weights = {each: np.asarray(stored[each]) for each in stored.files}
    except OSError as error:
        raise WeightsError(f"cannot read the weights {path}: {error.strerror or error}") from None
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, RuntimeError, MemoryError, SyntaxError):
        # RuntimeError: encrypted, or an unknown compression; SyntaxError: a header that is not valid Python
        raise WeightsError(f"cannot use the weights {path}: the file is damaged, or not an .npz of NumPy") from None
    if not _is_complete(weights):
        raise WeightsError(f"cannot use the weights {path}: they are not of {name}")
    return {each: array if each in _COUNTS else array.astype(np.float32) for each, array in weights.items()}


def write_weights(path: Path, weights: Weights) -> None:
    """Writes a file for :func:`read_weights`; equal weights give identical files.

    Raises:
        ValueError: the arrays are not those of :func:`shapes`.
    """
    if not _is_complete(weights):
        raise ValueError("these arrays are not the weights of a segment transformer")
    part = path.with_name(f"{path.name}.part")
    with open(part, "wb") as stream:
        np.savez(stream, **weights)  # pyright: ignore[reportArgumentType]
    part.replace(path)


def _is_complete(weights: Weights) -> bool:
    """Whether names, shapes, data types and counts are those of this network."""
    latents, queries = weights.get("pooling.latents"), weights.get("blocks.attention.query.weight")
    if latents is None or queries is None or latents.ndim != 2 or queries.ndim != 3 or 0 in latents.shape:
        return False
    width = latents.shape[1]
    expected = {**dict.fromkeys(_COUNTS, ()), **shapes(width, len(queries), len(latents))}
    if {name: array.shape for name, array in weights.items()} != expected:
        return False
    if any(array.dtype.kind != ("i" if name in _COUNTS else "f") for name, array in weights.items()):
        return False
    heads, iterations = (int(weights[name]) for name in _COUNTS)
    return 1 <= heads <= _MOST_HEADS and width % heads == 0 and 1 <= iterations <= _MOST_ITERATIONS
