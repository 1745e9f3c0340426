"""OpenAPI 3.1 description of the API, generated from the routes, their handlers' docstrings, and the options."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from typing import Any

from starlette.routing import Route

from unshutter.serve.fields import CANDIDATES, PhotoOptions
from unshutter.serve.schemas import schemas
from unshutter.version import __version__
from unshutter.video.options import RectifyClip

_BINARY = {"type": "string", "format": "binary"}

# Paths with the options of a photo or clip as query parameters, and paths that return a copy for the screen.
_OPTIONS = {
    **{f"/api/photos/{{id}}/{name}": PhotoOptions for name in ("after", "candidates", "segments", "picture", "motion")},
    **{f"/api/clips/{{id}}/{name}": RectifyClip for name in ("before", "after", "film", "readout")},
}
_COPIES = [f"/api/{kind}/{{id}}/{name}" for kind in ("photos", "clips") for name in ("before", "after")]
_STATUSES = {"POST /api/photos": 201, "POST /api/clips": 201, "POST /api/video": 202, "POST /api/saves": 202}
_REFUSALS = {
    400: "A field that is wrong.",
    401: "The token is missing or wrong.",
    404: "No such file is open.",
    413: "The file is too large.",
    422: "The file cannot be used.",
    503: "Too many requests: try again.",
}


def description(routes: Iterable[Route]) -> dict[str, Any]:
    """Generates the OpenAPI description.

    Args:
        routes: the server's routes; only those of the API are described.
    """
    paths: dict[str, Any] = {}
    for path, method, route in _addresses(routes):
        paths.setdefault(path, {})[method.lower()] = _operation(path, method, route)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "unshutter",
            "version": __version__,
            "description": "Removes rolling-shutter distortion from photos and clips. Fields are named as the flags of "
            '`unshutter rectify` and `unshutter video`, without dashes in front. Errors are JSON: {"error": one line}.',
        },
        "security": [{"bearer": []}, {"query": []}],
        "components": {
            "securitySchemes": {
                "bearer": {"type": "http", "scheme": "bearer"},
                "query": {"type": "apiKey", "in": "query", "name": "token"},
            }
        },
        "paths": paths,
    }


def _addresses(routes: Iterable[Route]) -> Iterator[tuple[str, str, Route]]:
    """Yields the path, method and route of each API address, except that of this description."""
    for route in routes:
        if route.path.startswith("/api/") and route.path != "/api/openapi.json":
            for method in sorted((route.methods or set()) - {"HEAD"}):
                yield route.path, method, route


def _operation(path: str, method: str, route: Route) -> dict[str, Any]:
    docstring = inspect.getdoc(route.endpoint) or ""
    summary = docstring.partition("\n\n")[0].partition("``: ")[2].replace("\n", " ")
    status = _STATUSES.get(f"{method} {path}", 204 if path in _DELETED and method == "DELETE" else 200)
    responses = {status: summary, **_REFUSALS}
    operation: dict[str, Any] = {
        "summary": summary,
        "parameters": list(_parameters(path, method)),
        "responses": {str(code): {"description": text} for code, text in responses.items()},
    }
    body = _BODIES.get(f"{method} {path}")
    if body is not None:
        operation["requestBody"] = {"required": True, "content": body()}
    if path in _ANSWERS:
        operation["responses"]["200"]["content"] = {_ANSWERS[path]: {}}
    return operation


def _parameters(path: str, method: str) -> Iterator[dict[str, Any]]:
    if "{id}" in path:
        yield {**_parameter("id", {"type": "string"}, "Of the open file or saving."), "in": "path", "required": True}
    if path in ("/api/photos", "/api/clips"):
        yield {**_parameter("Unshutter-Name", {"type": "string"}, "File name, percent-encoded."), "in": "header"}
    if path.startswith("/api/clips/") and path in (*_COPIES, "/api/clips/{id}/film"):
        yield _parameter("moment", {"type": "integer", "minimum": 0, "maximum": 4}, "Which of five moments.")
    if path in _OPTIONS:
        for name, schema in schemas(_OPTIONS[path]).items():
            yield _parameter(name, schema, schema["description"])
    if path in _COPIES:
        yield _parameter("longest", {"type": "string"}, "320, 1000, 1600, 2400 or full [px].")


def _estimate_form() -> dict[str, Any]:
    listed = {"type": "boolean", "default": False, "description": "List all motions that fit, instead of the first."}
    return _form("photo", {**schemas(PhotoOptions), CANDIDATES: listed})


def _rectify_form() -> dict[str, Any]:
    files = {
        name: {**_BINARY, "description": schemas(PhotoOptions)[name]["description"]} for name in ("before", "after")
    }
    motion = {**_BINARY, "description": "Undo the motion in this JSON file instead of estimating it."}
    return _form("photo", {**schemas(PhotoOptions), "motion": motion, **files})


def _clip_form() -> dict[str, Any]:
    return _form("clip", schemas(RectifyClip))


def _form(file: str, properties: dict[str, Any]) -> dict[str, Any]:
    schema = {"type": "object", "required": [file], "properties": {file: _BINARY, **properties}}
    return {"multipart/form-data": {"schema": schema}}


def _file() -> dict[str, Any]:
    return {"application/octet-stream": {"schema": _BINARY}}


def _saving() -> dict[str, Any]:
    item = {"type": "object", "properties": {"id": {"type": "string"}, "options": {"type": "object"}}}
    properties = {"to": {"enum": ["file", "zip", "folder"]}, "photos": {"type": "array", "items": item}}
    return {"application/json": {"schema": {"type": "object", "properties": properties}}}


def _parameter(name: str, schema: dict[str, Any], text: str) -> dict[str, Any]:
    return {"name": name, "in": "query", "schema": schema, "description": text}


_BODIES = {
    "POST /api/rectify": _rectify_form,
    "POST /api/estimate": _estimate_form,
    "POST /api/video": _clip_form,
    "POST /api/photos": _file,
    "POST /api/clips": _file,
    "POST /api/saves": _saving,
}
_ANSWERS = {"/api/rectify": "image/*", "/api/estimate": "application/json", "/api/clips/{id}/film": "video/webm"}
_DELETED = ("/api/photos/{id}", "/api/clips/{id}")
