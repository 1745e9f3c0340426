"""Training samples of places: what they show, and the motions that they are labelled with."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from support.drawn_places import save_place, streets
from unshutter.errors import UsageError
from unshutter_lab.synthesis.panorama import Camera, Place, pixel_directions, shipped_places
from unshutter_lab.training.atlases import Atlases
from unshutter_lab.training.config import from_table
from unshutter_lab.training.motions import MotionConfig
from unshutter_lab.training.pixels import PixelConfig, PixelData, Samples, rs_positions, sample
from unshutter_lab.training.places import PlacesConfig, PlaceViews
from unshutter_lab.training.towns import draw_place

torch.set_num_threads(1)
CPU = torch.device("cpu")
SIZE = 64
QUADRATICS = MotionConfig()


def dice(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("places")
    for seed in range(2):
        save_place(folder / f"yard_{seed}", streets(seed, 128))
    return folder


def samples(folder: Path, motions: MotionConfig, count: int = 12, **config: object) -> Samples:
    views = PlaceViews(from_table(PlacesConfig, {"folder": str(folder), "share": 1.0, **config}, ""))
    rs, gs, tx, rz = views.pictures([False] * count, SIZE, dice(), motions, with_gs=True)
    return Samples(rs, gs, torch.ones_like(rs[:, :1]), tx, rz)


def undone(made: Samples) -> torch.Tensor:
    """The error that remains in every picture once its motion is undone, where it is seen."""
    motion = torch.stack(made.row_motion(), 1)
    rectified, inside = sample(made.rs, *rs_positions(motion, None))
    return ((rectified - made.gs).abs() * inside).sum((1, 2, 3)) / inside.sum((1, 2, 3)) / 3


def unlike(made: Samples) -> torch.Tensor:
    return (made.rs - made.gs).abs().mean((1, 2, 3))


def test_the_labels_undo_the_papers_motions(folder: Path) -> None:
    made = samples(folder, QUADRATICS, still=0.0)
    assert unlike(made).median() > 0.04
    assert undone(made).max() < 0.35 * unlike(made).median()
    shifted = Samples(made.rs, made.gs, made.rs_valid, -made.tx_coefficients, made.rz_coefficients)
    assert undone(shifted).median() > 2 * undone(made).median()  # the sign matters
    assert made.tx_coefficients[:, 0].abs().max() == 0  # the first row is the reference


@pytest.mark.parametrize("kind", ["hand", "pan"])
def test_the_labels_of_a_camera_that_turns_come_near(folder: Path, kind: str) -> None:
    made = samples(folder, MotionConfig(**{kind: 1.0}), 24, still=0.0)
    assert undone(made).mean() < 0.75 * unlike(made).mean()  # what moves up and down remains
    assert undone(made).median() < 0.7 * unlike(made).median()


def test_a_camera_that_stands_still_has_no_motion(folder: Path) -> None:
    made = samples(folder, MotionConfig(hand=0.4, pan=0.3), still=1.0)
    torch.testing.assert_close(made.rs, made.gs)
    assert made.tx_coefficients.abs().max() == made.rz_coefficients.abs().max() == 0
    some = samples(folder, QUADRATICS, 200, still=0.3)
    assert 0.2 < (some.tx_coefficients.abs().sum(1) + some.rz_coefficients.abs().sum(1) == 0).float().mean() < 0.4


def test_no_view_is_seen_twice(folder: Path) -> None:
    made = samples(folder, QUADRATICS, still=1.0)
    flat = made.rs.flatten(1)
    assert torch.cdist(flat, flat).fill_diagonal_(9).min() > 1


def test_the_places_of_the_benchmark_are_never_trained_on(folder: Path, tmp_path: Path) -> None:
    name = next(iter(shipped_places()))
    save_place(tmp_path / name, streets(7, 16))
    with pytest.raises(UsageError, match="benchmark"):
        PlaceViews(PlacesConfig(folder=str(tmp_path), share=0.5))
    save_place(tmp_path / "yard", streets(8, 16))
    assert len(PlaceViews(PlacesConfig(folder=str(tmp_path), share=0.5)).places) == 1


def test_a_batch_of_cameras_sees_what_each_of_them_sees_alone(folder: Path) -> None:
    places = [Place.load(each) for each in sorted(folder.iterdir())] + [Place(streets(3, 48))]  # of two sizes
    atlases = Atlases(places, CPU)
    cameras = [
        Camera.of_view(24, 24, 70, yaw=20, tilt=35),
        Camera.of_view(24, 24, 45, yaw=200),
        Camera.of_view(24, 24, 60, roll=9),
    ]
    rows = [np.broadcast_to(camera.attitude(), (24, 3, 3)) for camera in cameras]
    focal = torch.tensor([camera.focal_px for camera in cameras])
    looks = pixel_directions(torch.tensor(np.stack(rows), dtype=torch.float32), focal[:, None], 24)
    seen = atlases.seen(torch.tensor([1, 0, 2]), looks, focal)
    alone = np.stack([places[k].seen(camera) for k, camera in zip((1, 0, 2), cameras, strict=True)])
    np.testing.assert_allclose(255 * seen.permute(0, 2, 3, 1), alone, atol=5)  # OpenCV weighs pixels in steps of 1/32
    atlases.replace(0, places[1])
    again = atlases.seen(torch.tensor([1, 0]), tuple(each[:1].expand(2, -1, -1) for each in looks), focal[:1].expand(2))
    torch.testing.assert_close(again[0], again[1])


def test_batches_mix_places_photos_and_drawn_places(folder: Path) -> None:
    config = PixelConfig(size=SIZE, canvas=88, drawn=6, held_out=2)
    places = {"folder": str(folder), "share": 0.4, "drawn": 1, "drawn_share": 0.25, "drawn_side": 32, "still": 0.0}
    data = PixelData(replace(config, places=places, light={"share": 0.5}), CPU)
    made = data.batch(16, dice())
    assert made.rs.shape == made.gs.shape == (16, 3, SIZE, SIZE)
    assert made.tx_coefficients.shape == (16, 4) and made.rs_valid.shape == (16, 1, SIZE, SIZE)
    assert data.batch(3, dice(1), with_gs=False).gs.numel() == 0
    assert data.places is not None
    counts = np.array([data.places.share_of(10, dice(k)) for k in range(400)])
    np.testing.assert_allclose(counts.mean(0), [4.0, 2.5], atol=0.1)
    again = data.batch(16, dice())
    torch.testing.assert_close(made.rs, again.rs)
    alone = PixelData(replace(config, places={**places, "share": 1.0, "drawn": 0, "drawn_share": 0.0}), CPU)
    assert alone.batch(4, dice()).rs_valid.min() == 1  # no photos among them


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"share": 0.5}, "places"),
        ({"folder": "x"}, "share"),
        ({"drawn": 3}, "share"),
        ({"folder": "x", "share": 1.5}, "between 0 and 1"),
        ({"folder": "x", "share": 0.8, "drawn": 1, "drawn_share": 0.3}, "together"),
    ],
)
def test_places_without_a_share_and_shares_without_places_are_refused(table: dict, problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        from_table(PlacesConfig, table, "[data.places]")


def test_a_drawn_town_stands_upright_and_shows_the_same_wall_from_everywhere() -> None:
    place = Place(draw_place(160, 3))
    assert place.seen(Camera.of_view(60, 60, 70)).std() > 8
    # a wall that two cameras see is the same wall: what the second sees to its left, the first sees to its right
    left, right = (place.seen(Camera(61, 61, 60.0, yaw=yaw)).astype(float) for yaw in (0.0, 20.0))
    col = np.tan(np.radians(20)) * 60 + 30
    assert np.abs(left[30, round(col)] - right[30, 30]).max() < 40
    other = Place(draw_place(160, 4))
    assert np.abs(other.seen(Camera.of_view(60, 60, 70)).astype(float) - left[:60, :60]).mean() > 10


def test_drawn_places_are_towns_and_rooms() -> None:
    above = [draw_place(48, seed)["posy"][20:28, 20:28].astype(float) for seed in range(8)]
    assert all(np.isfinite(each).all() for each in above)
    below = [draw_place(48, seed)["negy"].std() for seed in range(4)]
    assert min(below) > 0.5
