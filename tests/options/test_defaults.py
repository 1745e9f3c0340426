"""An option has one default: in Python, on the command line, in forms, on the page and, where it has it, for clips."""

import inspect
import json
import re
from pathlib import Path
from typing import Any

import pytest

import unshutter
from unshutter.cli.arguments import parse
from unshutter.cli.clip_command import VIDEO
from unshutter.cli.photo_commands import RECTIFY
from unshutter.errors import as_keyword, with_options
from unshutter.options import Camera, Rectify, Undo
from unshutter.options.clip_options import RectifyClip
from unshutter.options.fields import Option, options_of
from unshutter.page.settings import fields, page_module, read, read_clip

PHOTO = {option.key: option.default for option in options_of(Rectify)}
CLIP = {option.key: option.default for option in options_of(RectifyClip)}

# Photos and clips differ in two of these, for reasons that docs/reference/conventions.md gives.
EDGES = {"photo": "auto", "clip": "auto"}
REFERENCE = {"photo": "first", "clip": "middle"}
MODEL = {"photo": None, "clip": "camera"}


def test_clips_have_the_defaults_of_photos_but_for_two() -> None:
    differing = {key for key in PHOTO.keys() & CLIP.keys() if PHOTO[key] != CLIP[key]}
    assert differing == {"reference", "model"}
    assert (PHOTO["edges"], CLIP["edges"]) == tuple(EDGES.values())
    assert (PHOTO["reference"] or "first", CLIP["reference"]) == tuple(REFERENCE.values())
    assert (PHOTO["model"], CLIP["model"]) == tuple(MODEL.values())


@pytest.mark.parametrize("name", ["rectify", "estimate", "rectify_frames", "estimate_frames"])
def test_python_has_the_command_lines_defaults(name: str) -> None:
    parameters = inspect.signature(getattr(unshutter, name)).parameters
    shared = parameters.keys() & PHOTO.keys()
    assert len(shared) > 3
    assert {key: parameters[key].default for key in shared} == {key: PHOTO[key] for key in shared}


@pytest.mark.parametrize("option", [*options_of(Camera), *options_of(Undo)], ids=lambda option: option.name)
def test_an_option_is_on_every_surface_with_its_help(option: Option, capsys: pytest.CaptureFixture[str]) -> None:
    help = " ".join(option.help.split())
    assert option.key in inspect.signature(unshutter.rectify).parameters
    assert with_options(option.about, as_keyword) in " ".join((unshutter.rectify.__doc__ or "").split())
    with pytest.raises(SystemExit):
        parse("rectify", RECTIFY, ["--help-all"])
    assert f"--{option.name} " in (text := capsys.readouterr().out)
    assert "".join(help.split()) in "".join(text.split())
    assert {each.name: each.help for each in fields()}[option.name] == option.help
    assert json.dumps(option.help) in page_module()


def _flat(value: Any) -> dict[str, Any]:
    """Name -> value of the options in a dataclass, groups taken apart."""
    flat: dict[str, Any] = {}
    for key, each in vars(value).items():
        flat |= _flat(each) if hasattr(each, "__dataclass_fields__") else {key: each}
    return flat


def test_forms_have_the_command_lines_defaults() -> None:
    command_line = _flat(parse("rectify", RECTIFY, ["photo.jpg"]))
    form = _flat(read({}, Path).rectify)
    assert {key: command_line[key] for key in form} == form
    clip = _flat(parse("video", VIDEO, ["in.mp4", "-o", "out.mp4"]))
    form = _flat(read_clip({}))
    assert {key: clip[key] for key in form} == form


@pytest.mark.parametrize(("kind", "defaults"), [("photo", PHOTO), ("clip", CLIP)])
def test_the_page_has_these_defaults(kind: str, defaults: dict[str, Any]) -> None:
    module = re.search(rf"^export const {kind} = (.*);$", page_module(), re.MULTILINE)
    assert module is not None
    described = {name.replace("-", "_"): schema for name, schema in json.loads(module[1]).items()}
    shared = described.keys() & defaults.keys()
    assert {key: described[key].get("default") for key in shared} == {key: defaults[key] for key in shared}
    assert described["edges"]["default"] == EDGES[kind]
    reference = described["reference"]
    assert reference.get("default", reference["enum"][0]) == REFERENCE[kind]  # as the page takes it
