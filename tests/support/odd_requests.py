"""Requests to the page that are almost right: fields and JSON with something odd in them."""

import json
import random
from typing import Any

from support.fuzzing import CHANGES
from unshutter.options.fields import Option

TEXTS = (
    *("", " ", "0", "-1", "1e999", "1e308", "1e-320", "nan", "-inf", "0x10", "\uff11\uff12", "9" * 400, "1_0", "true"),
    *("auto", "null", "[]", "{}", "..", "/", "/etc/passwd", "file:///etc/passwd", "50%", "%05d", "@", "none@x.onnx"),
    *("--help", "$(id)", "a\nb", "\x00", "\x1b[31m", "\u202e", "\ufeff", "\ud800", "e\u0301" * 200, "\U0001f52c" * 100),
    *("x" * 9_000, "[" * 3_000),
)
VALUES: tuple[Any, ...] = (None, True, 0, -1, 2**70, 1e308, [], {}, [[]], {"id": 1}, *TEXTS[:6])
NUMBERS = (0, 0.5, 1, 2, 30, 0.02, 90, -90, 1e-9, 1e9, 200, 8, 33.3)
_DEPTH, _LONGEST_LIST = 100_000, 300


class Odd:
    """Draws requests at random, the same ones for the same seed.

    Args:
        seed: any number.
        ids: of open files, which fields may name.
        methods: names of estimators.
    """

    def __init__(self, seed: int, ids: list[str], methods: list[str]):
        self.random = random.Random(seed)
        self._ids, self._methods = ids, methods

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    def one(self, of: Any) -> Any:
        return self.random.choice(of)

    # ---- fields ----------------------------------------------------------------------------------------------

    def options(self, fields: list[Option], odd: float = 0.25) -> dict[str, str]:
        """A few options; each with a given chance not one that there is, or with no value that it takes."""
        some = self.random.sample(fields, self.one((0, 1, 1, 2, 3, 5)))
        options = {field.name: self.text(field) for field in some}
        for name in list(options):
            if self.chance(odd / 2):
                options[name] = self.one(TEXTS)
            elif self.chance(odd / 4):
                options[self.one((name.upper(), name.replace("-", "_"), self.one(TEXTS)))] = options.pop(name)
        return options

    def text(self, field: Option) -> str:
        """A value that a field may take."""
        if field.choices:
            return self.one(field.choices)
        if field.type is bool:
            return self.one(("true", "false", "1", "off"))
        if field.type in (int, float):
            return str(self.one(NUMBERS))
        if field.name == "estimator":
            return self.one(self._methods)
        return self.one(self._ids) if field.name in ("before", "after") else self.one(("ffv1", "fast", "GoPro", "x"))

    # ---- JSON ------------------------------------------------------------------------------------------------

    def json(self, whole: Any) -> bytes:
        """A JSON text: as it should be, with parts exchanged, or with bytes changed."""
        kind = self.random.random()
        if kind < 0.25:
            return json.dumps(whole).encode()
        if kind < 0.75:
            for _ in range(self.one((1, 1, 2, 3))):
                whole = self._changed(whole)
            data = json.dumps(whole).encode()
        else:
            data = json.dumps(whole).encode()
        if kind > 0.6:
            data = self.damaged(data)
        if self.chance(0.02):
            data = self.one((b"[", b'{"photos":', b'[{"to":')) * self.random.randint(1, _DEPTH) + data
        return data.decode("utf-8", "ignore").encode(self.one(("utf-16", "utf-32"))) if self.chance(0.02) else data

    def _changed(self, value: Any) -> Any:
        """The value with one place in it changed."""
        if isinstance(value, dict) and value and self.chance(0.8):
            key, changed = self.one(list(value)), dict(value)
            how = self.random.random()
            if how < 0.6:
                changed[key] = self._changed(value[key])
            elif how < 0.75:
                del changed[key]
            else:
                changed[self.one(TEXTS)] = changed.pop(key) if how < 0.9 else self.one(VALUES)
            return changed
        if isinstance(value, list) and value and self.chance(0.8):
            at = self.random.randrange(len(value))
            how = self.random.random()
            if how < 0.15:
                return value * self.random.randint(0, _LONGEST_LIST)
            return [*value[:at], *([] if how < 0.25 else [self._changed(value[at])]), *value[at + 1 :]]
        nested: Any = value
        for _ in range(self.one((0, 1, 3, 200)) if self.chance(0.3) else 0):
            nested = [nested]
        return nested if nested is not value else self.one(VALUES)

    def damaged(self, data: bytes) -> bytes:
        """The same with one to four changes."""
        changed = bytearray(data)
        for _ in range(self.random.randint(1, 4)):
            if changed:
                at = self.random.randrange(min(len(changed), 400) if self.chance(0.5) else len(changed))
                self.one(CHANGES)(changed, at, self.random.randint(1, 64), self.random.randrange(1 << 16))
        return bytes(changed)
