"""JSON Schemas of the options, used to generate the OpenAPI description and the page's controls."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from unshutter.estimators.register import names
from unshutter.options.description import Group, Option, describe
from unshutter.serve.fields import PhotoOptions
from unshutter.video.cameras import table
from unshutter.video.options import RectifyClip

_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string", Path: "string"}


def schemas(kind: type) -> dict[str, dict[str, Any]]:
    """Returns the schema of each option of a photo or clip, keyed by name."""
    return {option.name: _schema(option) for option, _ in _with_groups(kind)}


@cache
def page_module() -> str:
    """Generates a JavaScript module with ``photo`` and ``clip``: name -> schema with the group and known values."""
    known = {"estimator": names(), "camera": sorted({mode.name for mode in table()})}
    lines = ["// Made by the program from its one description of options (serve/schemas.py).\n"]
    for word, kind in (("photo", PhotoOptions), ("clip", RectifyClip)):
        described = {
            option.name: _schema(option) | {"group": group, "examples": known.get(option.name, [])}
            for option, group in _with_groups(kind)
        }
        lines.append(f"export const {word} = {json.dumps(described)};\n")
    return "".join(lines)


def _with_groups(kind: type, group: str = "") -> Iterator[tuple[Option, str]]:
    """Yields the options that a form can set, each with the name of its options dataclass in lower case."""
    for each in describe(kind):
        if isinstance(each, Group):
            yield from _with_groups(each.kind, each.kind.__name__.lower())
        elif each.on_page:
            yield each, group


def _schema(option: Option) -> dict[str, Any]:
    schema: dict[str, Any] = {"type": _TYPES[option.type], "description": option.help}
    if option.choices:
        schema["enum"] = list(option.choices)
    if option.default is not None:
        schema["default"] = option.default
    if option.limits is not None:
        schema["minimum"], schema["maximum"] = option.limits
    return schema
