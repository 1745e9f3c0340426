"""Python's keywords are the options of the dataclasses: the same types, defaults and help."""

import inspect
import re
import types
import typing

import pytest

import unshutter
from unshutter import rectification
from unshutter.frames import sequence, sequence_rectification
from unshutter.options import (
    Camera,
    CameraKeywords,
    Clock,
    ClockKeywords,
    Edges,
    FrameModel,
    Neighbours,
    Reference,
    Undo,
    UndoKeywords,
)
from unshutter.options.description import Option, describe, options_of

KEYWORDS = {
    "rectify": rectification.RectifyOptions,
    "rectified": rectification.RectifyOptions,
    "candidates": rectification.EstimateOptions,
    "estimate": rectification.LinesOptions,
    "rectify_frames": sequence_rectification.RectifyFramesOptions,
    "estimate_frames": sequence.FramesOptions,
}
FUNCTIONS = [getattr(unshutter, name) for name in KEYWORDS]


@pytest.mark.parametrize(("keywords", "kind"), [(CameraKeywords, Camera), (UndoKeywords, Undo), (ClockKeywords, Clock)])
def test_keywords_are_the_fields_with_their_types(keywords: type, kind: type) -> None:
    fields = [each.key for each in describe(kind) if isinstance(each, Option)]
    hints = typing.get_type_hints(kind)
    assert typing.get_type_hints(keywords) == {key: hints[key] for key in fields}


@pytest.mark.parametrize("function", FUNCTIONS)
def test_signature_and_docstring_have_every_option_with_its_default_and_help(function: typing.Any) -> None:
    parameters = inspect.signature(function).parameters
    source = inspect.unwrap(function).__doc__ or ""
    text = " ".join(inspect.cleandoc(function.__doc__).split())
    assert "options" not in parameters and "**options" not in text
    described = {each.key: each for kind in (Camera, Undo, Clock, Neighbours) for each in options_of(kind)}
    for name in parameters:
        assert f" {name}: " in text
        if name in described:
            assert parameters[name].default == described[name].default
            assert f" {name}: " in source or f"{name}: {' '.join(described[name].help.split())}" in text


@pytest.mark.parametrize(("name", "keywords"), KEYWORDS.items())
def test_types_of_keywords_are_those_of_the_fields(name: str, keywords: type) -> None:
    hints = {
        key: hint for kind in (Camera, Undo, Clock, Neighbours) for key, hint in typing.get_type_hints(kind).items()
    }
    own = {key: hint for key, hint in keywords.__annotations__.items() if key in hints}
    assert len(own) > 5
    assert {key: hint.__forward_arg__ for key, hint in own.items()} == {key: _written(hints[key]) for key in own}


def _written(hint: typing.Any) -> str:
    """A type as annotations write it."""
    names = {Reference: "Reference", Edges: "Edges", FrameModel: "FrameModel"}
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        return " | ".join(_written(each) for each in typing.get_args(hint) if each is not types.NoneType) + " | None"
    return names.get(hint) or hint.__name__


@pytest.mark.parametrize("function", FUNCTIONS)
def test_unknown_keywords_are_refused_as_python_refuses_them(function: typing.Any) -> None:
    message = re.escape(f"{function.__name__}() got an unexpected keyword argument 'strenght'")
    with pytest.raises(TypeError, match=message):
        function("photo.jpg", strenght=1)


@pytest.mark.parametrize(("name", "keywords"), KEYWORDS.items())
def test_what_editors_read_is_what_runs(name: str, keywords: type) -> None:
    parameters = inspect.signature(getattr(unshutter, name)).parameters
    assert {*parameters} == {*list(parameters)[:1], *keywords.__annotations__}
