"""Messages between this process and the one that runs networks (onnx_process.py): some words, and arrays, on a pipe.

A message is the length of its words (4 bytes), the words (JSON), and the bytes of the arrays one after another. The
words name each array's kind and shape under ``arrays``.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np

_LENGTH = struct.Struct("<I")
_KINDS = {"<f2", "<f4", "<f8", "|b1"}


def send(stream: BinaryIO, words: dict[str, Any], arrays: Sequence[np.ndarray] = ()) -> None:
    """Writes a message.

    Raises:
        OSError: nobody reads it any more.
    """
    text = json.dumps({**words, "arrays": [[array.dtype.str, array.shape] for array in arrays]}).encode()
    stream.write(_LENGTH.pack(len(text)) + text)
    for array in arrays:
        stream.write(array.tobytes())
    stream.flush()


def receive(stream: BinaryIO) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Reads a message: its words and its arrays.

    Raises:
        EOFError: the other side ended.
    """
    words = json.loads(_read(stream, _LENGTH.unpack(_read(stream, _LENGTH.size))[0]))
    arrays = []
    for kind, shape in words.pop("arrays"):
        if kind not in _KINDS:
            raise EOFError  # it cannot be trusted with what comes after
        dtype = np.dtype(kind)
        count = int(np.prod(shape, dtype=np.int64))
        arrays.append(np.frombuffer(_read(stream, count * dtype.itemsize), dtype).reshape(shape))
    return words, arrays


def _read(stream: BinaryIO, count: int) -> bytes:
    data = stream.read(count)
    if len(data) != count:
        raise EOFError
    return data
