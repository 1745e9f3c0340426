"""What every kind of motion must do, the same tests for all of them."""

import json
import pickle
import warnings
from dataclasses import fields, replace
from importlib.metadata import EntryPoints
from pathlib import Path

import numpy as np
import pytest

import unshutter
from unshutter import Finding, Motion, RotationMotion, RowMotion, ScanDirection, UnshutterError, UsageError
from unshutter.motion.warp import straighten
from unshutter.reasons import MotionSource, Reason

HEIGHT, WIDTH = 90, 120


def rows(**common) -> RowMotion:
    return RowMotion.from_polynomials([0, 12, -5], [0, 0.08, -0.03], HEIGHT, WIDTH, **common)


def rotations(**common) -> RotationMotion:
    u = np.linspace(0, 1, HEIGHT)[:, None]
    return RotationMotion(WIDTH, np.radians([[2, -3, 4]]) * u + np.radians([[-1, 2, -2]]) * u**2, 150.0, **common)


KINDS = {"rows": rows, "rotations": rotations}
every_kind = pytest.mark.parametrize("make", KINDS.values(), ids=KINDS)
every_reference = pytest.mark.parametrize("reference", ["first", "middle", "last"])


def grid() -> tuple[np.ndarray, np.ndarray]:
    col, row = np.meshgrid(np.arange(0, WIDTH, 7.0), np.arange(0, HEIGHT, 7.0))
    return col, row


def distances(positions: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    col, row = (p.ravel() for p in positions)
    return np.hypot(col[:, None] - col, row[:, None] - row)


# ---- the house rules --------------------------------------------------------------------------------------


def test_every_kind_is_tested_here() -> None:
    own = {name: kind for name, kind in Motion._kinds.items() if kind.__module__.startswith("unshutter.")}
    assert own == {kind: type(make()) for kind, make in KINDS.items()}
    assert {kind.__name__ for kind in own.values()} <= set(unshutter.__all__)


def test_a_motion_as_such_cannot_be_made() -> None:
    with pytest.raises(TypeError, match="abstract"):
        Motion(WIDTH)  # type: ignore[abstract]
    assert not any(hasattr(Motion, name) for name in ("zero", "from_polynomials", "from_key_rows"))


@every_kind
def test_kinds_are_final_and_override_nothing_concrete(make) -> None:
    kind = type(make())
    assert kind.__final__ and kind.__mro__[1] is Motion
    by_dataclass = {"__init__", "__setattr__", "__delattr__", "__replace__", "__dataclass_params__"}
    concrete = {name for name, value in vars(Motion).items() if callable(value) or isinstance(value, property)}
    assert not (concrete - Motion.__abstractmethods__ - by_dataclass) & set(vars(kind))


# ---- values -----------------------------------------------------------------------------------------------


@every_kind
def test_equal_by_value(make) -> None:
    assert make() == make()
    assert hash(make()) == hash(make())
    assert make() != make(scan_direction=ScanDirection.LEFT_TO_RIGHT)
    assert make() != make().scaled(0.5)
    assert [make() == other() for other in KINDS.values()].count(True) == 1
    assert make() != "a motion"


@every_kind
def test_the_repr_is_one_short_line(make) -> None:
    text = repr(make())
    assert text.startswith(f"{type(make()).__name__}(90 rows x 120, t_x up to ") and text.endswith(" deg)")
    found = repr(Finding(make(), estimator="x", confidence=0.931))
    assert found == f"Finding({text}, x, confidence 0.93)"
    assert len(found) < 140
    assert repr(Finding(make(), reason=Reason.stated("nothing to see"))).endswith("given, nothing to see)")


def test_the_repr_says_how_much_moves() -> None:
    motion = RowMotion(800, np.linspace(0, -41.2, 600), np.linspace(0, np.radians(0.8), 600))
    assert repr(motion) == "RowMotion(600 rows x 800, t_x up to 41.2 px, r_z up to 0.8 deg)"


@every_kind
def test_pickled(make) -> None:
    motion = make(scan_direction=ScanDirection.LEFT_TO_RIGHT)
    motion.gs_to_rs(*grid())  # fills the caches
    back = pickle.loads(pickle.dumps(motion))
    assert back == motion
    np.testing.assert_array_equal(back.gs_to_rs(*grid()), motion.gs_to_rs(*grid()))
    assert not back.tx_px.flags.writeable


@every_kind
def test_arrays_cannot_be_changed(make) -> None:
    motion = make()
    arrays = [motion.tx_px, motion.rz_rad, *(getattr(motion, field.name) for field in fields(motion))]
    for array in arrays:
        assert not isinstance(array, np.ndarray) or not array.flags.writeable


# ---- changed into -----------------------------------------------------------------------------------------


@every_kind
@every_reference
def test_another_reference(make, reference) -> None:
    """The same picture moved and turned as a whole; zero at its row; there and back is the same motion."""
    motion = make()
    other = motion.rereferenced(reference)
    assert (type(other), other.reference) == (type(motion), reference)
    assert other.tx_px[other.reference_row] == other.rz_rad[other.reference_row] == 0
    back = other.rereferenced("first")
    np.testing.assert_allclose(back.gs_to_rs(*grid()), motion.gs_to_rs(*grid()), atol=1e-9)
    np.testing.assert_allclose(back.rs_to_gs(*grid()), motion.rs_to_gs(*grid()), atol=1e-9)
    one, two = motion.rates(), other.rates()
    assert (one[0].shape, one[1].shape) == ((HEIGHT,), (HEIGHT, 2)) and np.isfinite(one[1]).all()
    np.testing.assert_allclose(two[0], one[0], atol=1e-8)
    np.testing.assert_allclose(two[1], one[1], atol=2e-3)
    with pytest.raises(UsageError, match="tenth"):
        motion.rereferenced("tenth")


@every_reference
def test_another_reference_sees_the_same_scene_from_another_pose(reference) -> None:
    """What stood at p in the first row's picture stands at R p + t in the other's: both look at one RS position."""
    motion = rows()
    other = motion.rereferenced(reference)
    tx, rz = motion.tx_px[other.reference_row], motion.rz_rad[other.reference_row]
    col, row = grid()
    x, y = col - (WIDTH - 1) / 2, row - (HEIGHT - 1) / 2
    there = x * np.cos(rz) - y * np.sin(rz) + tx, x * np.sin(rz) + y * np.cos(rz)
    moved = there[0] + (WIDTH - 1) / 2, there[1] + (HEIGHT - 1) / 2
    np.testing.assert_allclose(other.gs_to_rs(*moved), motion.gs_to_rs(col, row), atol=1e-9)


@every_kind
@every_reference
@pytest.mark.parametrize("size", [(180, 240), (45, 60), (91, 120)])
def test_resized(make, reference, size) -> None:
    """Positions of pixel centres scale as (p + 1/2) s - 1/2, up to the half row by which the reference row moved."""
    motion = make().rereferenced(reference)
    other = motion.resized(*size)
    assert (other.height, other.width, other.reference) == (*size, reference)
    assert other.tx_px[other.reference_row] == pytest.approx(0, abs=1e-12)
    across, down = size[1] / WIDTH, size[0] / HEIGHT
    col, row = grid()
    large = other.gs_to_rs((col + 0.5) * across - 0.5, (row + 0.5) * down - 0.5)
    back = (large[0] + 0.5) / across - 0.5, (large[1] + 0.5) / down - 0.5
    np.testing.assert_allclose(back, motion.gs_to_rs(col, row), atol=0.35)
    inside = (slice(2, -2), slice(2, -2))
    rigid = [distances((c[inside], r[inside])) for c, r in (back, motion.gs_to_rs(col, row))]
    np.testing.assert_allclose(*rigid, atol=0.3)


@every_kind
def test_its_own_size_is_itself(make) -> None:
    motion = make()
    assert motion.resized(HEIGHT, WIDTH) is motion
    for size in ((120, 90), (0, 0), (10, 1), (3_000_000, 4_000_000)):
        with pytest.raises(UnshutterError):
            motion.resized(*size)


@every_kind
def test_scaled(make) -> None:
    motion = make().rereferenced("middle")
    assert motion.scaled(1) == motion
    assert motion.scaled(0).is_zero and not motion.is_zero
    tilting = RotationMotion(WIDTH, np.linspace([0, 0, 0], [0.05, 0, 0], HEIGHT), 150.0)
    assert not tilting.is_zero  # although t_x and r_z are
    np.testing.assert_allclose(motion.scaled(0).gs_to_rs(*grid()), grid(), atol=1e-9)
    np.testing.assert_allclose(motion.scaled(0.5).rz_rad, motion.rz_rad / 2, atol=2e-4)
    for wrong in (-0.1, 2.5, float("nan")):
        with pytest.raises(UsageError, match="strength"):
            motion.scaled(wrong)


@every_kind
def test_one_row_is_enough(make) -> None:
    motion = make()
    first = {"rotations": motion.rotations[:1]} if isinstance(motion, RotationMotion) else {}
    single = replace(motion, **(first or {"tx_px": motion.tx_px[:1], "rz_rad": motion.rz_rad[:1]}))
    single.check_unfolded()
    np.testing.assert_allclose(single.gs_to_rs(3.0, 0.0), (3.0, 0.0), atol=1e-9)
    assert Motion.from_json(single.to_json()) == single


# ---- the file ---------------------------------------------------------------------------------------------


@every_kind
@every_reference
def test_a_file_gives_back_the_same_motion_and_picture(make, reference, tmp_path: Path) -> None:
    motion = make(scan_direction=ScanDirection.RIGHT_TO_LEFT).rereferenced(reference)
    found = Finding(motion, estimator="x", source=MotionSource.PIXELS, confidence=0.25, version="0.0.9")
    found.save(tmp_path / "m.json")
    assert Finding.load(tmp_path / "m.json") == found
    back = Motion.load(tmp_path / "m.json")
    assert type(back) is type(motion)
    assert back == motion
    assert json.loads(motion.to_json())["kind"] == motion.kind
    pixels = np.random.default_rng(1).integers(0, 256, (WIDTH, HEIGHT, 3), dtype=np.uint8)
    assert np.array_equal(straighten(pixels, back)[0], straighten(pixels, motion)[0])


@every_kind
def test_other_programs_find_the_row_motion_in_every_file(make) -> None:
    data = json.loads(make().to_json())
    assert data["tx_px"] == make().tx_px.tolist()
    assert data["rz_rad"] == make().rz_rad.tolist()


@pytest.mark.parametrize("make", [rows, rotations])
def test_files_without_a_kind_still_read(make) -> None:
    data = json.loads(make().to_json())
    del data["kind"]
    assert Motion.from_json(json.dumps(data)) == make()


@every_kind
@pytest.mark.parametrize("kind", ["waves", [], None, "rows" * 1000])
def test_unknown_kinds(make, kind) -> None:
    data = json.loads(make().to_json()) | {"kind": kind}
    with pytest.raises(UnshutterError, match="kind") as caught:
        Motion.from_json(json.dumps(data))
    assert len(str(caught.value)) < 300


def test_a_motion_of_another_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    data = json.loads(rows().to_json()) | {"kind": "elsewhere", "estimator": "kandula2020-research"}
    monkeypatch.setattr("unshutter.version.plugins", lambda group: EntryPoints())
    with pytest.raises(UnshutterError, match=r"of the method that found it \(kandula2020-research; pip install"):
        Motion.from_json(json.dumps(data))


# ---- numbers that no photo has ----------------------------------------------------------------------------


IMPOSSIBLE = [
    {"width": 10**7},
    {"width": 10**400},
    {"width": 0},
    {"confidence": 2.0},
    {"confidence": float("nan")},
    {"tx_px": np.full(HEIGHT, 1e308)},
    {"tx_px": np.full(HEIGHT, 2e6)},
    {"rz_rad": np.full(HEIGHT, 7.0)},
    {"rz_rad": np.full(HEIGHT, np.nan)},
    {"rz_rad": np.zeros(HEIGHT + 1)},
    {"center_shift_px": 1e300},
    {"focal_px": 1e300},
    {"focal_px": 1e-300},
    {"focal_px": float("inf")},
    {"rotations": np.full((HEIGHT, 3), 1e308)},
]


@every_kind
def test_impossible_numbers_are_refused_in_one_line_and_without_warnings(make) -> None:
    motion = make()
    names = {field.name for field in fields(motion)}
    for change in IMPOSSIBLE:
        if names.issuperset(change):
            with warnings.catch_warnings(), pytest.raises(UnshutterError) as caught:
                warnings.simplefilter("error")
                replace(motion, **change)
            assert "\n" not in str(caught.value) and len(str(caught.value)) < 120
