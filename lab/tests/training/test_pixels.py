"""The data path of networks that read pixels."""

import math

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from unshutter.errors import UsageError
from unshutter.motion import RowMotion
from unshutter_lab.training.config import from_table
from unshutter_lab.training.facades import draw_facades
from unshutter_lab.training.pixels import (
    PixelConfig,
    PixelData,
    Samples,
    draw_picture,
    load_photos,
    pixel_grid,
    sample,
    synthesise,
)
from unshutter_lab.training.recipes import epe
from unshutter_lab.training.variation import view_homography

torch.set_num_threads(1)
CPU = torch.device("cpu")
SMALL = PixelConfig(size=64, canvas=88, drawn=6, held_out=2)


def dice(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def noise(size: int) -> torch.Tensor:
    return torch.randint(0, 256, (1, 3, size, size), dtype=torch.uint8, generator=dice())


def shear(px_per_row: float, rotation: float = 0.0) -> tuple[torch.Tensor, torch.Tensor]:
    """Coefficients of t_x = px_per_row * row, r_z = rotation * row / size."""
    return torch.tensor([[px_per_row, 0.0, 0.0]]), torch.tensor([[rotation, 0.0, 0.0]])


def test_a_shear_moves_row_i_by_i_pixels_to_the_right():
    canvas = noise(88)
    samples = synthesise(canvas, *shear(1.0), 64)
    expected = canvas.float() / 255
    torch.testing.assert_close(samples.gs, expected[..., 12:76, 12:76])
    for row in (0, 1, 5, 12):
        shifted = expected[0, :, 12 + row, 12 - row : 76 - row]
        torch.testing.assert_close(samples.rs[0, :, row], shifted, atol=2e-5, rtol=0)


def test_outside_of_the_canvas_is_black_and_marked():
    samples = synthesise(noise(88), *shear(1.0), 64)
    # row 20 starts 20 px to the left of column 12 of the canvas: its first 8 pixels show nothing
    assert samples.rs_valid[0, 0, 20].tolist() == [0.0] * 8 + [1.0] * 56
    assert not samples.rs[0, :, 20, :8].any()


def test_true_motion_per_row():
    tx, rz = synthesise(noise(88), *shear(0.25, 0.1), 64).row_motion()
    torch.testing.assert_close(tx[0], 0.25 * torch.arange(64.0))
    torch.testing.assert_close(rz[0], 0.1 * torch.arange(64.0) / 64)


def test_rotation_matches_motion_and_opencv():
    """The same picture by the NumPy geometry and OpenCV's bilinear sampling."""
    canvas = torch.from_numpy(draw_picture(88, 3))[None]
    samples = synthesise(canvas, *shear(-0.3, 0.15), 64)
    rows = np.arange(64)
    motion = RowMotion(64, -0.3 * rows, 0.15 * rows / 64)
    row, col = np.mgrid[0:64, 0:64].astype(float)
    x, y = motion.rs_to_gs(col, row)
    whole = canvas[0].permute(1, 2, 0).numpy().astype(np.float32) / 255
    expected = cv2.remap(whole, (x + 12).astype(np.float32), (y + 12).astype(np.float32), cv2.INTER_LINEAR)
    valid = samples.rs_valid[0, 0].numpy() > 0
    assert valid.mean() > 0.9
    # OpenCV rounds positions to 1/32 px
    assert np.abs(samples.rs[0].permute(1, 2, 0).numpy() - expected)[valid].max() < 0.05


def test_sampling_between_pixels():
    values, inside = sample(
        torch.tensor([[[[0.0, 2.0], [4.0, 10.0]]]]), torch.tensor([[[0.5, 1.01]]]), torch.tensor([[[0.25, 0.5]]])
    )
    assert values[0, 0, 0, 0].item() == pytest.approx(0.75 * 1 + 0.25 * 7)
    assert values[0, 0, 0, 1].item() == 0
    assert inside.tolist() == [[[[1.0, 0.0]]]]


def test_epe_of_a_shear_is_its_mean_shift_over_what_is_seen():
    samples = synthesise(noise(88), *shear(0.5), 64)
    shifts = [0.5 * row for row in range(64) for col in range(64) if col + 0.5 * row <= 63]
    assert epe(*pixel_grid(samples.size, samples.rs), samples).item() == pytest.approx(np.mean(shifts), rel=1e-5)


def test_epe_of_the_truth_is_zero():
    samples = PixelData(SMALL, CPU).batch(4, dice())
    motions = [RowMotion(64, tx, rz) for tx, rz in zip(*(m.numpy() for m in samples.row_motion()), strict=True)]
    row, col = np.mgrid[0:64, 0:64].astype(float)
    positions = np.stack([m.gs_to_rs(col, row) for m in motions], 1)
    x, y = torch.from_numpy(positions).float()
    assert epe(x, y, samples).max() < 0.02  # rows beyond the last are another question to both
    assert (epe(x + 3, y - 4, samples) - 5).abs().max() < 0.02


def test_batches_follow_the_generator():
    data = PixelData(SMALL, CPU)
    first, again, other = data.batch(4, dice(1)), data.batch(4, dice(1)), data.batch(4, dice(2))
    assert torch.equal(first.rs, again.rs) and torch.equal(first.tx_coefficients, again.tx_coefficients)
    assert not torch.equal(first.rs, other.rs)


def test_first_photos_and_mirror_images():
    data = PixelData(SMALL, CPU)
    photo = data.photos[0][:, 12:76, 12:76].float() / 255
    seen = data.batch(16, dice(), first_photos=1).gs
    mirrored = [torch.equal(p, photo.flip(-1)) for p in seen]
    assert all(m or torch.equal(p, photo) for m, p in zip(mirrored, seen, strict=True))
    assert 0 < sum(mirrored) < 16


def test_held_out_pictures_are_not_trained_on():
    data = PixelData(SMALL, CPU)
    assert len(data.photos) == 4 and len(data.held_out) == 2
    assert not any(torch.equal(a, b) for a in data.photos for b in data.held_out)
    batches = [list(data.validation()) for _ in range(2)]
    assert [len(b.rs) for b in batches[0]] == [4]
    assert torch.equal(batches[0][0].rs, batches[1][0].rs)


def test_photos_of_a_folder(tmp_path):
    (tmp_path / "more").mkdir()
    wide, tall = np.full((100, 300, 3), (10, 20, 30), np.uint8), np.full((160, 80, 3), 7, np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), wide)
    cv2.imwrite(str(tmp_path / "more" / "b.jpg"), tall)
    (tmp_path / "notes.txt").write_text("no photo")
    first, second = load_photos(tmp_path, 50)
    assert first.shape == (3, 50, 100) and second.shape == (3, 100, 50)  # at most 2:1
    assert first[:, 0, 0].tolist() == [30, 20, 10]  # RGB
    data = PixelData(PixelConfig(folder=str(tmp_path), size=32, canvas=44, held_out=1), CPU)
    assert len(data.photos) == len(data.held_out) == 1
    assert data.batch(2, dice()).rs.shape == (2, 3, 32, 32)


def test_unreadable_photos_are_left_out_with_a_warning(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((60, 60, 3), np.uint8))
    (tmp_path / "b.jpg").write_bytes(b"")
    (tmp_path / "c.jpg").write_text("not a photo")
    with pytest.warns(UserWarning, match="2 of 3 files"):
        assert len(load_photos(tmp_path, 50)) == 1


def test_bad_requests(tmp_path):
    with pytest.raises(UsageError, match="margin"):
        PixelData(PixelConfig(size=64, canvas=89), CPU)
    with pytest.raises(UsageError, match="held_out must be at least 1"):
        PixelData(PixelConfig(size=64, canvas=88, held_out=0), CPU)


def test_too_few_pictures_are_refused_with_the_number_needed(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((60, 60, 3), np.uint8))
    for given, says in (
        ({"drawn": 2, "held_out": 2}, "2 pictures are drawn; training needs at least 3 "),
        ({"folder": str(tmp_path), "held_out": 4}, "holds 1 readable photo.s.; training needs at least 5 .4 held out"),
        ({"folder": str(tmp_path / "missing")}, "there is no folder .*missing; training needs at least 41 "),
        (
            {"folder": str(tmp_path), "validation_folder": str(tmp_path / "v")},
            "no folder .*v; training needs",
        ),
    ):
        with pytest.raises(UsageError, match=says):
            PixelData(PixelConfig(size=32, canvas=44, **given), CPU)


def test_samples_know_their_frame():
    samples = next(PixelData(SMALL, CPU).validation())
    assert isinstance(samples, Samples) and samples.size == 64 and samples.center == (31.5, 31.5)
    col, row = pixel_grid(3, samples.rs)
    assert col.tolist() == [[0, 1, 2]] and row.tolist() == [[0], [1], [2]]


# ---- more from each photo ---------------------------------------------------------------------------------


def varied(**more) -> PixelData:
    return PixelData(PixelConfig(size=64, canvas=88, drawn=6, held_out=2, **more), CPU)


def test_the_distorted_picture_of_another_camera_is_its_own_distorted():
    """What the other camera sees is one picture: distorting that picture gives the same as distorting its view."""
    smooth = torch.nn.functional.avg_pool2d(noise(120).float(), 9, 1, 4).round().to(torch.uint8)
    angles = [torch.tensor([math.radians(a)]) for a in (3.0, 8.0, -10.0)]
    view = view_homography(*angles, torch.tensor([150.0]), torch.tensor([1.2]), torch.tensor([[2.0, -3.0]]))
    motion = shear(0.1, 0.05)
    ours = synthesise(smooth, *motion, 64, view)
    wide = synthesise(smooth, *shear(0.0), 88, view)  # the same view, with a margin
    expected = synthesise((wide.gs * 255).round().to(torch.uint8), *motion, 64)
    valid = (expected.rs_valid * ours.rs_valid).bool().expand_as(ours.rs)
    assert valid.float().mean() > 0.9
    assert (ours.rs - expected.rs)[valid].abs().max() < 0.03
    assert (ours.gs - expected.gs).abs().max() < 0.01


def test_varied_training_pictures_and_unchanged_held_out_ones():
    plain = varied()
    other = varied(views={"share": 1.0}, light={"share": 1.0}, motions={"hand": 0.5})
    assert not torch.equal(plain.batch(4, dice()).rs, other.batch(4, dice()).rs)
    assert torch.equal(next(plain.validation()).rs, next(other.validation()).rs)
    first, again = other.batch(4, dice(1)), other.batch(4, dice(1))
    assert torch.equal(first.rs, again.rs) and torch.equal(first.gs, again.gs)
    assert first.rs.min() >= 0 and first.rs.max() <= 1
    assert not (first.rs * (1 - first.rs_valid)).any()


def test_the_undistorted_pictures_can_be_left_out():
    for data in (varied(), varied(views={"share": 1.0}, light={"share": 1.0})):
        whole, half = data.batch(3, dice()), data.batch(3, dice(), with_gs=False)
        assert torch.equal(whole.rs, half.rs) and half.gs.shape == (3, 0, 64, 64)
        assert half[1:].gs.shape == (2, 0, 64, 64)


def test_a_share_of_the_training_pictures_is_drawn(tmp_path):
    for name in "abc":
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((100, 100, 3), 77, np.uint8))
    data = varied(folder=str(tmp_path), drawn_share=0.25)
    photo = (data.batch(400, dice()).gs == 77 / 255).flatten(1).all(1).float().mean().item()
    assert photo == pytest.approx(0.75, abs=0.06)


def test_other_checks_are_the_same_at_each_call():
    data = varied(motions={"hand": 0.2, "pan": 0.1}, light={"share": 1.0})
    checks = [{name: next(iter(batches)) for name, batches in data.other_checks().items()} for _ in range(2)]
    assert list(checks[0]) == ["val_epe_hand", "val_epe_pan", "train_epe", "train_epe_as_seen"]
    for name, samples in checks[0].items():
        assert len(samples.rs) == 4 and torch.equal(samples.rs, checks[1][name].rs)
    assert list(varied().other_checks()) == ["train_epe", "train_epe_as_seen"]


def test_unknown_settings_of_what_varies_are_refused():
    with pytest.raises(UsageError, match=r"data.views.*unknown setting 'rol'"):
        varied(views={"rol": 1.0})


def test_drawn_facades_are_upright_and_differ():
    first, again, other = (draw_facades(128, seed) for seed in (0, 0, 4))
    assert first.shape == (3, 128, 128) and first.dtype == np.uint8
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    across, down = 0.0, 0.0
    for seed in range(8):  # in a level camera's picture of walls, the strongest edges are plumb
        grey = draw_facades(128, seed).mean(0).astype(np.float32)[8:-8, 8:-8]
        rise = np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0)), np.abs(cv2.Sobel(grey, cv2.CV_32F, 0, 1))
        strong = rise[0] + rise[1] > 200
        across += (strong & (rise[1] < 0.02 * rise[0])).sum()
        down += (strong & (np.abs(rise[1] - 0.2 * rise[0]) < 0.02 * rise[0])).sum()
    assert across > 2 * down


def test_training_on_drawn_facades_alone():
    data = varied(drawn_kind="facades")
    assert np.array_equal(data.photos[0].numpy(), draw_facades(88, int(np.random.default_rng(0).permutation(6)[2])))
    with pytest.raises(UsageError, match="unknown drawn_kind"):
        from_table(PixelConfig, {"drawn_kind": "castles"}, "[data]")
