"""The description of the API (OpenAPI 3.1), made from the options themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from unshutter.serve.fields import PhotoOptions, fields
from unshutter.version import __version__
from unshutter.video.options import RectifyClip

_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string", Path: "string"}
_BINARY = {"type": "string", "format": "binary"}


def description() -> dict[str, Any]:
    """The whole description."""
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "unshutter",
            "version": __version__,
            "description": "Undoes rolling-shutter distortion in photos and clips. Fields are named as the flags of "
            '`unshutter rectify` and `unshutter video`, without dashes in front. Errors are JSON: {"error": one line}.',
        },
        "security": [{"bearer": []}, {"query": []}],
        "components": {
            "securitySchemes": {
                "bearer": {"type": "http", "scheme": "bearer"},
                "query": {"type": "apiKey", "in": "query", "name": "token"},
            }
        },
        "paths": {**_for_programs(), **_of_photos(), **_of_clips(), **_of_saves()},
    }


def _for_programs() -> dict[str, Any]:
    motion = {**_BINARY, "description": "Undo the motion in this JSON file instead of finding it."}
    files = {name: {**_BINARY, "description": _options()[name]["description"]} for name in ("before", "after")}
    whole = "A photo with its motion undone, whole, with its metadata."
    picture = _from_form(whole, {"motion": motion, **files}, "image/*")
    found = _from_form("A photo's motion as JSON, format unshutter-motion/1.", {}, "application/json")
    return {
        "/api/rectify": {"post": picture},
        "/api/estimate": {"post": found},
        "/api/video": {"post": _clip_from_form()},
        "/api/about": {"get": _one("The version, the largest photo and clip [bytes], and the folder to save to.")},
        "/api/wake": {"post": _one("Loads what the first photo would wait for.")},
    }


def _of_photos() -> dict[str, Any]:
    photo, longest = (
        "/api/photos/{id}",
        _parameter("longest", {"type": "string"}, "320, 1000, 1600, 2400 or full [px]."),
    )
    options = [_parameter(name, schema, schema.get("description", "")) for name, schema in _options().items()]
    name = {**_parameter("Unshutter-Name", {"type": "string"}, "File name, percent-encoded."), "in": "header"}
    body = {"required": True, "content": {"application/octet-stream": {"schema": _BINARY}}}
    id = {**_parameter("id", {"type": "string"}, "Of the photo."), "in": "path", "required": True}
    seen = [id, *options]
    before = "The photo for a screen (JPEG); the header Unshutter-Result says what its file says."
    after = "The rectified photo for a screen (JPEG); the header Unshutter-Result says what was done."
    return {
        "/api/photos": {"post": {**_one("Opens a photo: its id.", [name], "201"), "requestBody": body}},
        photo: {
            "delete": _one("Closes the photo.", [id], "204"),
        },
        f"{photo}/before": {"get": _one(before, [id, longest])},
        f"{photo}/after": {"get": _one(after, [*seen, longest])},
        f"{photo}/segments": {"get": _one("Line segments, as shares of width and height, before and after.", seen)},
        f"{photo}/picture": {"get": _one("The rectified photo, whole, with its metadata.", seen)},
        f"{photo}/motion": {"get": _one("Its motion as JSON.", seen)},
    }


def _of_clips() -> dict[str, Any]:
    clip = "/api/clips/{id}"
    id = {**_parameter("id", {"type": "string"}, "Of the clip."), "in": "path", "required": True}
    moment = _parameter("moment", {"type": "integer", "minimum": 0, "maximum": 4}, "Which of five moments.")
    longest = _parameter("longest", {"type": "string"}, "320, 1000, 1600, 2400 or full [px].")
    options = [_parameter(name, schema, schema["description"]) for name, schema in _options(RectifyClip).items()]
    name = {**_parameter("Unshutter-Name", {"type": "string"}, "File name, percent-encoded."), "in": "header"}
    body = {"required": True, "content": {"application/octet-stream": {"schema": _BINARY}}}
    before = "A moment of the clip for a screen (JPEG); the header Unshutter-Result says what its file says."
    after = "The same moment straightened (JPEG); the header Unshutter-Result says what was done."
    return {
        "/api/clips": {"post": {**_one("Opens a clip: its id.", [name], "201"), "requestBody": body}},
        clip: {"delete": _one("Closes the clip.", [id], "204")},
        f"{clip}/before": {"get": _one(before, [id, moment, longest, *options])},
        f"{clip}/after": {"get": _one(after, [id, moment, longest, *options])},
        f"{clip}/readout": {"get": _one("The readout time of its camera, given or found.", [id, *options])},
    }


def _of_saves() -> dict[str, Any]:
    id = {**_parameter("id", {"type": "string"}, "Of the saving."), "in": "path", "required": True}
    one = {"type": "object", "properties": {"id": {"type": "string"}, "options": {"type": "object"}}}
    wanted = {
        "type": "object",
        "properties": {"to": {"enum": ["file", "zip", "folder"]}, "photos": {"type": "array", "items": one}},
    }
    body = {"required": True, "content": {"application/json": {"schema": wanted}}}
    return {
        "/api/saves": {"post": {**_one("Saves open photos and clips: an id.", [], "202"), "requestBody": body}},
        "/api/saves/{id}": {"delete": _one("Cancels a saving, or forgets what it has made.", [id])},
        "/api/saves/{id}/events": {"get": _one("How far it is (server-sent events).", [id])},
        "/api/saves/{id}/file": {"get": _one("The zip file, or the one photo or clip.", [id])},
    }


def _options(kind: type = PhotoOptions) -> dict[str, dict[str, Any]]:
    """The schema of each option of a photo or clip, by its name."""
    schemas = {}
    for field in fields(kind):
        schema: dict[str, Any] = {"type": _TYPES[field.type], "description": field.help}
        if field.choices:
            schema["enum"] = list(field.choices)
        if field.default is not None:
            schema["default"] = field.default
        schemas[field.name] = schema
    return schemas


def _from_form(summary: str, more: dict[str, Any], answer: str) -> dict[str, Any]:
    schema = {"type": "object", "required": ["photo"], "properties": {"photo": _BINARY, **_options(), **more}}
    operation = _one(summary)
    operation["responses"]["200"]["content"] = {answer: {}}
    return {**operation, "requestBody": {"required": True, "content": {"multipart/form-data": {"schema": schema}}}}


def _clip_from_form() -> dict[str, Any]:
    summary = (
        "Begins to straighten a clip: the id of a saving. /api/saves/{id}/events says how far it is, and "
        "/api/saves/{id}/file is the clip when its state is `finished`."
    )
    schema = {"type": "object", "required": ["clip"], "properties": {"clip": _BINARY, **_options(RectifyClip)}}
    body = {"required": True, "content": {"multipart/form-data": {"schema": schema}}}
    return {**_one(summary, [], "202"), "requestBody": body}


def _one(summary: str, parameters: list[dict[str, Any]] | None = None, status: str = "200") -> dict[str, Any]:
    refusals = {
        "400": "A field that is wrong.",
        "401": "The token is missing or wrong.",
        "404": "No such file is open.",
        "413": "The file is too large.",
        "422": "The file cannot be used.",
        "503": "Too many requests: try again.",
    }
    responses = {status: summary, **refusals}
    return {
        "summary": summary,
        "parameters": parameters or [],
        "responses": {code: {"description": text} for code, text in responses.items()},
    }


def _parameter(name: str, schema: dict[str, Any], text: str) -> dict[str, Any]:
    return {"name": name, "in": "query", "schema": schema, "description": text}
