"""Messages to and from the process that runs networks (onnx_process.py): words and arrays on a pipe.

A message consists of the length of its words (4 bytes), the words (JSON), and the bytes of the arrays in order. The
words list each array's kind and shape under ``arrays``.
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
        OSError: the reader is gone.
    """
    text = json.dumps({**words, "arrays": [[array.dtype.str, array.shape] for array in arrays]}).encode()
    stream.write(_LENGTH.pack(len(text)) + text)
    for array in arrays:
        stream.write(array.tobytes())
    stream.flush()


def receive(stream: BinaryIO) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Reads a message: its words and its arrays.

    Raises:
        EOFError: the writer has ended.
    """
    words = json.loads(_read(stream, _LENGTH.unpack(_read(stream, _LENGTH.size))[0]))
    arrays = []
    for kind, shape in words.pop("arrays"):
        if kind not in _KINDS:
            raise EOFError  # the rest cannot be trusted
        dtype = np.dtype(kind)
        count = int(np.prod(shape, dtype=np.int64))
        arrays.append(np.frombuffer(_read(stream, count * dtype.itemsize), dtype).reshape(shape))
    return words, arrays


def _read(stream: BinaryIO, count: int) -> bytes:
    data = stream.read(count)
    if len(data) != count:
        raise EOFError
    return data
