import hashlib
import json

import numpy as np
import pytest

from support.drawn_photos import drawn, encoded, one_line, textured
from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion
from unshutter.photo import Photo
from unshutter_lab.synthesis.options import Synthesize
from unshutter_lab.synthesis.pairs import synthesize, synthesize_folder, synthesize_native
from unshutter_lab.synthesis.row_motions import DrawnMotion, draw_quadratic


def fixed(tx_at_end, rz_at_end, rows=64, canvas=96):
    """A motion that grows with the row: linear t_x, quadratic r_z."""
    u = np.arange(canvas) / canvas
    return DrawnMotion.of_canvas(tx_at_end * u, rz_at_end * u**2, rows, {})


def bilinear_at(canvas, col, row):
    """Plain NumPy; 0 outside."""
    last = len(canvas) - 1
    within = (col >= 0) & (col <= last) & (row >= 0) & (row <= last)
    col, row = np.clip(col, 0, last), np.clip(row, 0, last)
    left, top = np.minimum(col.astype(int), last - 1), np.minimum(row.astype(int), last - 1)
    fx, fy = (col - left)[..., None], (row - top)[..., None]
    p = canvas.astype(float)
    upper = p[top, left] * (1 - fx) + p[top, left + 1] * fx
    lower = p[top + 1, left] * (1 - fx) + p[top + 1, left + 1] * fx
    return (upper * (1 - fy) + lower * fy) * within[..., None], within


# ---- one pair ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_pair_obeys_the_equation_of_motion(dtype):
    """RS pixel p of the crop shows the canvas where Eq. 1 of the crop's own motion says, worked out here."""
    motion = fixed(25, 0.2)
    canvas = drawn(96, 96, dtype=dtype)
    rs, gs = synthesize(canvas, motion)
    assert rs.shape == gs.shape == (64, 64, 3)
    assert rs.dtype == gs.dtype == dtype
    assert np.array_equal(gs, canvas[16:80, 16:80])
    row, col = np.mgrid[:64, :64].astype(float)
    t, r = motion.crop.tx_px[:, None], motion.crop.rz_rad[:, None]
    x, y = col - 31.5 - t, row - 31.5
    gs_col, gs_row = x * np.cos(r) + y * np.sin(r) + 31.5, y * np.cos(r) - x * np.sin(r) + 31.5
    expected, within = bilinear_at(canvas, gs_col + 16, gs_row + 16)
    # libvips rounds weights and pixels
    assert np.abs(rs - expected)[within].max() <= (1.5 if dtype == np.uint8 else 257)
    assert not rs[~within].any()


def test_pair_is_the_middle_square_resized_by_area():
    photo = textured(192, 288)
    _, gs = synthesize(photo, fixed(0, 0))
    middle = photo[:, 48:240].reshape(96, 2, 96, 2, 3).mean((1, 3))[16:80, 16:80]
    assert np.abs(gs - middle).max() <= 1
    rs, again = synthesize(photo, fixed(0, 0))
    assert np.array_equal(rs, again)  # no motion


@pytest.mark.parametrize("shape", [(100, 150), (100, 150, 1), (150, 100, 4), (40, 50, 3)])
def test_channels_stay(shape):
    photo = textured(*shape) if len(shape) == 3 else textured(*shape, 1)[..., 0]
    rs, gs = synthesize(photo, fixed(5, 0.02))
    assert rs.shape == gs.shape == (64, 64, *shape[2:])


@pytest.mark.parametrize(("height", "width"), [(300, 420), (357, 301)])
def test_native_pair(height, width):
    photo = textured(height, width)
    drawn_motion = draw_quadratic(np.random.default_rng(2))
    rs, gs, motion = synthesize_native(photo, drawn_motion)
    side = min(height, width)
    n = round(256 * side / 356)
    assert rs.shape == gs.shape == (n, n, 3)
    assert (motion.height, motion.width) == (n, n)
    top, left = ((s - (side - (side - n) % 2)) // 2 + (side - n) // 2 for s in (height, width))
    assert np.array_equal(gs, photo[top : top + n, left : left + n])
    # the pair belongs to its motion: following it back finds the same picture
    row, col = np.mgrid[:n, :n].astype(float)
    at_col, at_row = motion.rs_to_gs(col, row)
    expected, within = bilinear_at(gs, at_col, at_row)
    assert within.mean() > 0.5
    assert np.abs(rs - expected)[within].max() <= 2


# ---- folders ----------------------------------------------------------------------------------------------


@pytest.fixture
def photos(tmp_path):
    (tmp_path / "in").mkdir()
    paths = [tmp_path / "in" / name for name in ("house.jpg", "tree.png", "grey.png")]
    paths[0].write_bytes(encoded(textured(120, 160), "JPEG"))
    paths[1].write_bytes(encoded(textured(130, 110), "PNG"))
    paths[2].write_bytes(encoded(textured(128, 128, 1)[..., 0], "PNG"))
    return paths


def digests(folder):
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


SMALL = {"size": 64, "canvas": 90}
ONE = Synthesize(**SMALL)


def test_folder_holds_pairs_motions_and_a_manifest(photos, tmp_path):
    calls = []
    failed = synthesize_folder(
        photos, tmp_path / "out", Synthesize(per_photo=2, seed=5, **SMALL), progress=lambda: calls.append(1)
    )
    assert failed == []
    assert len(calls) == 3
    names = [f"{stem}_0{k}" for stem in ("house", "tree", "grey") for k in (0, 1)]
    for kind, suffix in (("rs", "png"), ("gs", "png"), ("motion", "json")):
        assert sorted(p.name for p in (tmp_path / "out" / kind).iterdir()) == sorted(f"{n}.{suffix}" for n in names)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["format"] == "unshutter-synthesis/1"
    assert [manifest[k] for k in ("motion", "per_photo", "seed", "size", "canvas")] == ["quadratic", 2, 5, 64, 90]
    assert [pair["name"] for pair in manifest["pairs"]] == names
    assert manifest["pairs"][0]["photo_sha256"] == hashlib.sha256(photos[0].read_bytes()).hexdigest()
    # what is written is what was drawn: the manifest's numbers give the motion, the motion gives the picture
    pair = manifest["pairs"][2]
    motion = Motion.load(tmp_path / "out" / "motion" / "tree_00.json")
    i, first = np.arange(13, 77), 13
    a, b = pair["drawn"]["alpha_tx"], pair["drawn"]["beta_tx"]
    tx = (a * 25 * (i**2 - first**2) / 90**2 + b * 5 * (i - first) / 90) * 64 / 256
    assert motion.tx_px == pytest.approx(tx, abs=1e-5)
    gs = Photo.open(tmp_path / "out" / "gs" / "tree_00.png").to_array()
    rs = Photo.open(tmp_path / "out" / "rs" / "tree_00.png").to_array()
    row, col = np.mgrid[:64, :64].astype(float)
    expected, within = bilinear_at(gs, *motion.rs_to_gs(col, row))
    assert np.abs(rs - expected)[within].max() <= 2
    assert Photo.open(tmp_path / "out" / "rs" / "grey_00.png").bands == 1


def test_same_seed_same_bytes_whatever_the_company(photos, tmp_path):
    two = Synthesize(per_photo=2, seed=1, **SMALL)
    synthesize_folder(photos, tmp_path / "a", two)
    synthesize_folder(photos, tmp_path / "b", two)
    assert digests(tmp_path / "a") == digests(tmp_path / "b")
    synthesize_folder([photos[1]], tmp_path / "alone", Synthesize(per_photo=3, seed=1, **SMALL))
    together, alone = digests(tmp_path / "a"), digests(tmp_path / "alone")
    for name in ("rs/tree_00.png", "rs/tree_01.png", "gs/tree_01.png", "motion/tree_00.json"):
        assert together[name] == alone[name]
    synthesize_folder(photos, tmp_path / "c", Synthesize(per_photo=2, seed=2, **SMALL))
    assert digests(tmp_path / "c")["motion/tree_00.json"] != together["motion/tree_00.json"]
    assert together["motion/tree_00.json"] != together["motion/tree_01.json"] != together["motion/house_01.json"]


def test_bad_photos_are_reported_and_the_run_goes_on(photos, tmp_path):
    bad = tmp_path / "in" / "text.jpg"
    bad.write_text("not a picture")
    small = tmp_path / "in" / "small.png"
    small.write_bytes(encoded(textured(30, 200), "PNG"))
    missing = tmp_path / "in" / "missing.png"
    calls = []
    failed = synthesize_folder(
        [bad, photos[0], missing, small], tmp_path / "out", ONE, progress=lambda: calls.append(1)
    )
    assert [photo for photo, _ in failed] == [bad, missing, small]
    assert "200x30 px" in failed[2][1]
    assert all("\n" not in message for _, message in failed)
    assert len(calls) == 4
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert [pair["name"] for pair in manifest["pairs"]] == ["house_00"]
    assert [f["photo"] for f in manifest["failed"]] == [str(p) for p in (bad, missing, small)]


def test_photos_of_the_same_name_both_stay(photos, tmp_path):
    other = tmp_path / "in" / "more"
    other.mkdir()
    for name in ("house.png", "HOUSE.png"):
        (other / name).write_bytes(encoded(textured(90, 90), "PNG"))
    synthesize_folder([photos[0], other / "house.png", other / "HOUSE.png"], tmp_path / "out", ONE)
    names = sorted(p.stem for p in (tmp_path / "out" / "rs").iterdir())
    assert names == ["HOUSE_00-3", "house_00", "house_00-2"]


def test_trajectory_folder(photos, tmp_path):
    t = np.arange(400) / 100
    np.savez(tmp_path / "log.npz", t_s=t, gyro_rad_s=np.stack([0.5 + 0 * t, 0 * t, -0.2 + 0 * t], 1))
    trajectory = {"motion": "trajectory", "trajectory": tmp_path / "log.npz", "readout_ms": 40.0, "focal_px": 100.0}
    synthesize_folder(photos[:1], tmp_path / "out", Synthesize(**trajectory, **SMALL))
    motion = Motion.load(tmp_path / "out" / "motion" / "house_00.json")
    turned = np.arange(64) * 0.04 / 64
    assert motion.tx_px == pytest.approx(100 * np.tan(0.5 * turned), abs=2e-6)
    assert motion.rz_rad == pytest.approx(-0.2 * turned, abs=2e-9)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["readout_ms"], manifest["focal_px"]) == (40, 100)
    assert manifest["trajectory_sha256"] == hashlib.sha256((tmp_path / "log.npz").read_bytes()).hexdigest()
    assert 0 <= manifest["pairs"][0]["drawn"]["start_s"] < 3.95


@pytest.mark.parametrize(
    "options",
    [
        {"per_photo": 0},
        {"seed": -1},
        {"motion": "cubic"},
        {"motion": "trajectory"},
        {"motion": "trajectory", "readout_ms": 30.0, "focal_px": 400.0},
        {"readout_ms": 30.0},
        {"size": 64, "canvas": 60},
    ],
)
def test_options_that_do_not_fit(photos, tmp_path, options):
    with pytest.raises(UsageError) as error:
        synthesize_folder(photos, tmp_path / "out", Synthesize(**options))
    one_line(error)
    assert not (tmp_path / "out").exists()


def test_no_photos(tmp_path):
    with pytest.raises(UsageError, match="no photos"):
        synthesize_folder([], tmp_path / "out")


def test_a_missing_trajectory_writes_nothing(photos, tmp_path):
    options = {"motion": "trajectory", "trajectory": tmp_path / "no.npz", "readout_ms": 30.0, "focal_px": 400.0}
    with pytest.raises(UnshutterError, match=r"no\.npz") as error:
        synthesize_folder(photos, tmp_path / "out", Synthesize(**options))
    one_line(error)
    assert not (tmp_path / "out").exists()


def test_a_folder_with_something_in_it_is_left_alone(photos, tmp_path):
    before = digests(tmp_path / "in")
    with pytest.raises(UnshutterError, match="is not empty"):
        synthesize_folder(photos, tmp_path / "in", ONE)
    with pytest.raises(UnshutterError, match="is a file"):
        synthesize_folder(photos, photos[0], ONE)
    assert digests(tmp_path / "in") == before
    with pytest.raises(UnshutterError, match="cannot write"):
        synthesize_folder(photos, photos[0] / "out", ONE)
    (tmp_path / "empty").mkdir()
    assert synthesize_folder(photos[:1], tmp_path / "empty", ONE) == []


def test_a_full_disc_stops_the_run_without_a_manifest(photos, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(UnshutterError, match="No space left on device"):
        synthesize_folder(photos, tmp_path / "out", ONE)
    left = [p for p in (tmp_path / "out").rglob("*") if p.is_file()]
    assert not any(p.name == "manifest.json" or "part" in p.name for p in left)
