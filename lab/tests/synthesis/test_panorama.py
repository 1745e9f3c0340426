"""Views of places, whose colours are known in every direction."""

from pathlib import Path

import numpy as np
import pytest

from support.drawn_places import LOOKS, cube, save_place, smooth, unit, upright_stripes
from unshutter import Motion, RowMotion, UnshutterError
from unshutter.motion import RotationMotion
from unshutter_lab.methods.row_map import RowMapMotion
from unshutter_lab.synthesis.panorama import Camera, Place, face_positions, row_matrices, shipped_places

HEIGHT, WIDTH, FOCAL = 90, 120, 100.0
SMOOTH = Place(cube(smooth))


def true_directions(col: np.ndarray, row: np.ndarray, yaw: float, tilt: float, roll: float) -> np.ndarray:
    """Where a camera looks, worked out by hand: turned about its axis, then up, then to the right."""
    x, y, z = (col - (WIDTH - 1) / 2) / FOCAL, (row - (HEIGHT - 1) / 2) / FOCAL, np.ones_like(col)
    yaw, tilt, roll = np.radians([yaw, tilt, roll])
    x, y = x * np.cos(roll) - y * np.sin(roll), x * np.sin(roll) + y * np.cos(roll)
    y, z = y * np.cos(tilt) - z * np.sin(tilt), y * np.sin(tilt) + z * np.cos(tilt)
    x, z = x * np.cos(yaw) + z * np.sin(yaw), z * np.cos(yaw) - x * np.sin(yaw)
    return unit(np.stack([x, y, z], -1))


def pixels() -> tuple[np.ndarray, np.ndarray]:
    row, col = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    return col, row


def camera(**attitude: float) -> Camera:
    return Camera(HEIGHT, WIDTH, FOCAL, **attitude)


@pytest.mark.parametrize("yaw", [0, 45, 137, 215, 300])
@pytest.mark.parametrize(("tilt", "roll"), [(0, 0), (12, -7), (-35, 20), (60, 90), (-88, 3)])
def test_a_camera_sees_the_colours_of_where_it_looks(yaw: float, tilt: float, roll: float) -> None:
    seen = SMOOTH.seen(camera(yaw=yaw, tilt=tilt, roll=roll))
    true = smooth(true_directions(*pixels(), yaw, tilt, roll))
    assert np.abs(seen - true).max() < 3  # across seams and corners, too


@pytest.mark.parametrize("yaw", range(0, 360, 25))
def test_verticals_are_upright_without_roll_whatever_yaw_and_tilt_are(yaw: float) -> None:
    place = Place(cube(upright_stripes, 256))
    level = place.seen(camera(yaw=yaw)).astype(int)
    assert (level.max(0) - level.min(0)).max() < 12  # every column has one colour
    for tilt in (-20, 15, 38):
        tilted = place.seen(camera(yaw=yaw, tilt=tilt)).astype(int)
        middle = tilted[:, WIDTH // 2 - 1 : WIDTH // 2 + 1].mean(1)
        assert (middle.max(0) - middle.min(0)).max() < 12
        mirrored = place.seen(camera(yaw=yaw, tilt=tilt, roll=10)).astype(int)
        lean = mirrored[:, WIDTH // 2 - 1 : WIDTH // 2 + 1].mean(1)
        assert (lean.max(0) - lean.min(0)).max() > 25


def test_the_angles_turn_the_camera_as_they_say() -> None:
    ahead = [camera(**angle).attitude() @ [0, 0, 1] for angle in ({"yaw": 30}, {"tilt": 30})]
    np.testing.assert_allclose(ahead[0], [0.5, 0, np.sqrt(0.75)], atol=1e-12)  # to the right
    np.testing.assert_allclose(ahead[1], [0, -0.5, np.sqrt(0.75)], atol=1e-12)  # up: y points down
    right = camera(roll=30).attitude() @ [1, 0, 0]
    np.testing.assert_allclose(right, [np.sqrt(0.75), 0.5, 0], atol=1e-12)  # clockwise: its right side sinks


def test_every_pixel_of_a_face_is_found_again() -> None:
    side = 8
    for number, name in enumerate(("posx", "negx", "posy", "negy", "posz", "negz")):
        right, below, ahead = (np.array(axis, float) for axis in LOOKS[name])
        line = (np.arange(side) + 0.5) / side * 2 - 1
        directions = 7.5 * (line[None, :, None] * right + line[:, None, None] * below + ahead)
        col, row = face_positions(*np.moveaxis(directions, -1, 0), side)
        np.testing.assert_allclose(col, np.broadcast_to(np.arange(side) + 1, (side, side)), atol=1e-5)
        np.testing.assert_allclose(row[:, 0], np.arange(side) + 1 + number * (side + 2), atol=1e-5)


def paper_motion() -> RowMotion:
    return RowMotion.from_polynomials([0, 30, -25], [0, 0.2, -0.1], HEIGHT, WIDTH)


def turning_motion(degrees: tuple[float, float, float] = (6.0, -14.0, 9.0)) -> RotationMotion:
    share = np.linspace(0, 1, HEIGHT)[:, None]
    rotations = np.radians(np.array(degrees)) * (share + 0.3 * np.sin(3 * share))
    return RotationMotion(width=WIDTH, rotations=rotations - rotations[0], focal_px=FOCAL)


@pytest.mark.parametrize("motion", [paper_motion(), turning_motion(), turning_motion((-20.0, 50.0, -25.0))])
@pytest.mark.parametrize("reference", ["first", "middle", "last"])
def test_each_row_sees_what_the_product_says_that_it_saw(motion: Motion, reference) -> None:
    motion = motion.rereferenced(reference)
    attitude = {"yaw": 77.0, "tilt": 14.0, "roll": -4.0}
    seen = SMOOTH.seen(camera(**attitude), row_matrices(motion, FOCAL))
    col, row = motion.rs_to_gs(*pixels())  # far outside the picture, where the motion is large
    true = smooth(true_directions(col, row, **attitude))
    assert np.abs(seen - true).max() < 3
    still = SMOOTH.seen(camera(**attitude))
    assert np.abs(seen.astype(int) - still).max() > 20
    at = motion.reference_row
    assert np.abs(seen[at].astype(int) - still[at]).max() <= 1


def test_a_motion_of_another_kind_is_refused() -> None:
    zero = np.zeros(HEIGHT)
    common = {"residual_px": np.zeros((HEIGHT, WIDTH)), "corner": (0, 0), "size": (WIDTH, HEIGHT)}
    motion = RowMapMotion(width=WIDTH, tx_px=zero, rz_rad=zero, **common)
    with pytest.raises(UnshutterError, match="RowMapMotion"):
        row_matrices(motion, FOCAL)


def test_a_small_picture_is_not_sampled_too_coarsely() -> None:
    rng = np.random.default_rng(0)
    grain = Place({name: rng.integers(0, 256, (128, 128, 3), np.uint8) for name in LOOKS})
    large = grain.seen(Camera.of_view(128, 128, 90))
    small = grain.seen(Camera.of_view(16, 16, 90))
    assert small.std() < 0.5 * large.std()
    assert abs(small.mean() - large.mean()) < 4


def test_the_view_is_that_of_the_longer_side() -> None:
    for height, width in ((300, 400), (400, 300)):
        focal = Camera.of_view(height, width, 90.0).focal_px
        assert focal == pytest.approx(200)


def test_a_place_is_read_from_its_folder(tmp_path: Path) -> None:
    faces = cube(smooth, 32)
    folder = save_place(tmp_path / "yard", faces)
    view = Camera(20, 30, 25.0, yaw=50, tilt=40)
    np.testing.assert_array_equal(Place.load(folder).seen(view), Place(faces).seen(view))
    (folder / "posy.png").unlink()
    with pytest.raises(UnshutterError, match="posy is missing"):
        Place.load(folder)


def test_a_place_needs_six_square_faces_of_one_size() -> None:
    faces = cube(smooth, 16)
    with pytest.raises(UnshutterError, match="missing are negx, posy"):
        Place({name: face for name, face in faces.items() if name not in ("negx", "posy")})
    with pytest.raises(UnshutterError, match="one size"):
        Place({**faces, "posz": faces["posz"][:8, :8]})
    with pytest.raises(UnshutterError, match="one size"):
        Place({name: face[:, :8] for name, face in faces.items()})


def test_sixteen_places_come_with_the_laboratory() -> None:
    places = shipped_places()
    assert len(places) == 16
    assert sum(file.stat().st_size for folder in places.values() for file in folder.iterdir()) < 6_000_000
    assert all(len(list(folder.glob("*.jpg"))) == 6 for folder in places.values())
    for name in ("hansaplatz", "potsdamer_platz"):
        assert Place.load(places[name]).seen(Camera.of_view(60, 80, 60)).std() > 10
