"""Python's keywords are the options of the dataclasses: the same types, defaults, help and checks."""

import dataclasses
import inspect
import re
import typing
from pathlib import Path

import pytest

import unshutter
from unshutter.errors import UsageError, as_keyword, with_options
from unshutter.options import Camera, Clock, Find, Neighbours, Save, Undo
from unshutter.options.clip_options import ClipUndo, RectifyClip, Steadiness
from unshutter.options.fields import describe, for_python, from_keywords, option, options_of

PHOTO, FRAMES = (Camera, Undo, Find), (Clock, Camera, Undo, Neighbours)
KINDS: dict[str, tuple[type, ...]] = {
    "rectify": PHOTO,
    "estimate": PHOTO,
    "candidates": PHOTO,
    "rectify_frames": FRAMES,
    "estimate_frames": FRAMES,
    "rectify_clip": (RectifyClip,),
    "rectify_clip_frames": (Clock, Camera, ClipUndo, Steadiness),
}
DEMO = Path(__file__).parents[2] / "examples" / "demo.jpg"
WIDER = {"estimator": "str | Estimator", "motion": "Motion | str | os.PathLike[str] | None"}  # than on the command line


def fields_of(kind: type) -> typing.Iterator[tuple[str, str]]:
    """Name and annotation of the options of a dataclass and of those in it."""
    hints = typing.get_type_hints(kind)
    for field in dataclasses.fields(kind):
        if dataclasses.is_dataclass(hints[field.name]):
            yield from fields_of(hints[field.name])
        else:
            yield field.name, str(field.type)


@pytest.mark.parametrize(("name", "kinds"), KINDS.items())
def test_keywords_have_the_types_defaults_and_help_of_the_options(name: str, kinds: tuple[type, ...]) -> None:
    function = getattr(unshutter, name)
    parameters, text = inspect.signature(function).parameters, " ".join(inspect.cleandoc(function.__doc__).split())
    source = inspect.getsource(inspect.unwrap(function))
    types = dict(pair for kind in reversed(kinds) for pair in fields_of(kind))
    options = {each.key: each for kind in reversed(kinds) for each in options_of(kind)}
    shared = parameters.keys() & options.keys()
    assert len(shared) > 5 and {"readout", "focal_px"} < shared
    for key in shared:
        path = types[key].replace("Path", "str | Path")
        assert parameters[key].kind is inspect.Parameter.KEYWORD_ONLY
        assert parameters[key].default == options[key].default
        assert parameters[key].annotation in (types[key], path, WIDER.get(key))
        help = " ".join(with_options(options[key].about, as_keyword).split())
        assert f" {key}: " in source or f" {key}: {help}" in text
    assert all(f" {key}: " in text for key in parameters)


def test_clips_take_every_option_in_python() -> None:
    assert {each.key for each in options_of(RectifyClip)} < inspect.signature(unshutter.rectify_clip).parameters.keys()


@pytest.mark.parametrize("name", KINDS)
def test_unknown_keywords_are_refused_as_python_refuses_them(name: str) -> None:
    with pytest.raises(TypeError, match=re.escape(f"{name}() got an unexpected keyword argument 'strenght'")):
        getattr(unshutter, name)("photo.jpg", strenght=1)


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("strength", "half", "strength must be a number, got 'half'"),
        ("focal_px", [1], "focal_px must be a number, got [1]"),
        (
            "readout",
            3,
            "readout must be one of auto, top-to-bottom, ",
        ),
        ("edges", None, "edges must be one of "),
        ("estimator", 3, "estimator must be the name of a method or an Estimator, got 3"),
        ("motion", 3, "motion must be a"),
        ("lines", 3, "lines must be a list of DrawnLine or the path of a file of lines, got 3"),
        ("candidate", 1.5, "candidate must be a whole number, got 1.5"),
        ("moving", "no", "moving must be one of yes, left, right, up, down, got no"),
        ("moving", False, "moving must be one of yes, left, right, up, down, got False"),
        ("no_film", "no", "no_film must be True or False, got 'no'"),
        ("fps", "30", "fps must be a number, got '30'"),
        ("crf", "low", "crf must be a number, got 'low'"),
    ],
)
def test_values_of_another_type_are_refused_in_a_sentence(name: str, key: str, value: object, message: str) -> None:
    function = getattr(unshutter, name)
    if key not in inspect.signature(function).parameters:
        return
    photo = ["no.mp4", "out.mp4"] if name == "rectify_clip" else [DEMO]
    with pytest.raises(UsageError, match=re.escape(message)):
        function(*photo, **{key: value})


def test_errors_in_python_name_keywords() -> None:
    with pytest.raises(UsageError, match=r"^give readout_ratio, or readout_ms with fps, not both$"):
        unshutter.estimate_frames([], readout_ratio=0.5, fps=30)
    with pytest.raises(UsageError, match=r"^level needs stabilize$"):
        unshutter.rectify_clip("in.mp4", "out.mp4", level=True)
    with pytest.raises(UsageError, match=r"^min_confidence must lie between 0 and 1, got 2$"):
        unshutter.rectify(DEMO, min_confidence=2)


def test_a_number_of_any_kind_is_a_number() -> None:
    np = pytest.importorskip("numpy")
    assert from_keywords(Undo, {"strength": np.float32(0.5)}) == Undo(strength=0.5)
    assert from_keywords(Save, {"quality": np.int64(80), "other": 1}) == Save(quality=80)


def test_help_is_added_once_for_each_option() -> None:
    @dataclasses.dataclass(frozen=True)
    class Kind:
        """A kind."""

        one: int = option(1, "The first, see {--two-too}.")
        two_too: int = option(2, "Not shown.")

    @for_python(Kind)
    def function(*, one: int = 1, two_too: int = 2) -> None:
        """Does.

        Args:
            two_too: own words.

        Returns:
            Nothing.
        """

    assert [each.key for each in describe(Kind)] == ["one", "two_too"]
    assert inspect.cleandoc(function.__doc__ or "").splitlines()[2:5] == [
        "Args:",
        "    two_too: own words.",
        "    one: The first, see two_too.",
    ]


def test_true_is_what_the_flag_alone_means() -> None:
    assert from_keywords(Camera, {"moving": True}) == from_keywords(Camera, {"moving": "yes"})
    with pytest.raises(UsageError, match="edges must be one of"):
        from_keywords(Undo, {"edges": True})
