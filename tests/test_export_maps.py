"""Maps as other programs read and apply them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.covering import covering
from support.drawn_photos import one_line, textured
from unshutter import Motion, RowMotion, ScanDirection, UnshutterError, UsageError, version
from unshutter.cli import main
from unshutter.export import PixelMap, map_file
from unshutter.motion.warp import validity_mask
from unshutter.options import Camera, Find
from unshutter.photo import Photo

HEIGHT, WIDTH = 150, 200


def shake(readout: str = "top-to-bottom", **about) -> Motion:
    direction = ScanDirection(readout)
    height, width = direction.frame_size(HEIGHT, WIDTH)
    return RowMotion.from_polynomials([0, 14, -5], [0, -0.02, 0.06], height, width, scan_direction=direction, **about)


def stored(tmp_path: Path, motion: Motion) -> Path:
    path = tmp_path / "motion.json"
    motion.save(path)
    return path


def read_st(path: Path) -> np.ndarray:
    """[H, W, 3] of an ST map, first row on top."""
    if path.suffix == ".tif":
        return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1].copy()
    exr = pytest.importorskip("OpenEXR")
    with exr.File(str(path)) as file:
        return file.channels()["RGB"].pixels.copy()


def apply_st(picture: np.ndarray, st: np.ndarray) -> np.ndarray:
    """What a compositing program makes of an ST map, from its definition: (0, 0) is the picture's lower left corner
    and (1, 1) its upper right one, so pixels are turned upside down and their centres are halfway between."""
    height, width = picture.shape[:2]
    upside_down = picture[::-1].copy()
    col, row_from_below = st[..., 0] * width - 0.5, st[..., 1] * height - 0.5
    return cv2.remap(upside_down, col, row_from_below, cv2.INTER_CUBIC)


def core(mask: np.ndarray) -> np.ndarray:
    """Where no border takes part in the interpolation."""
    return cv2.erode(mask.astype(np.uint8), np.ones((7, 7)), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0


@pytest.mark.parametrize("readout", [*ScanDirection])
def test_opencv_with_the_npz_rectifies(tmp_path: Path, readout: ScanDirection) -> None:
    rs, motion = textured(HEIGHT, WIDTH), shake(readout)
    assert main(["map", str(stored(tmp_path, motion)), "-o", str(tmp_path / "m.npz")]) == 0
    with np.load(tmp_path / "m.npz") as maps:
        assert sorted(maps) == ["map_x", "map_y"]
        assert maps["map_x"].dtype == maps["map_y"].dtype == np.float32
        found = cv2.remap(rs, maps["map_x"], maps["map_y"], cv2.INTER_CUBIC)
    expected = unshutter.rectify(rs, motion=motion, edges="keep").array
    seen = core(validity_mask(motion))
    assert seen.mean() > 0.6
    difference = np.abs(found.astype(int) - expected)[seen]
    assert difference.mean() < 0.7  # OpenCV's positions are good to 1/32 px and its cubic is another one
    assert difference.max() <= 10
    assert np.abs(rs.astype(int) - expected)[seen].mean() > 5


@pytest.mark.parametrize(("suffix", "readout"), covering([".exr", ".tif"], [*ScanDirection]))
def test_an_st_map_rectifies(tmp_path: Path, readout: ScanDirection, suffix: str) -> None:
    if suffix == ".exr":
        pytest.importorskip("OpenEXR")
    rs, motion, path = textured(HEIGHT, WIDTH), shake(readout), tmp_path / f"m{suffix}"
    assert main(["map", str(stored(tmp_path, motion)), "-o", str(path)]) == 0
    st = read_st(path)
    assert (st.shape, st.dtype) == ((HEIGHT, WIDTH, 3), np.float32)
    assert np.array_equal(st[..., 2] > 0.5, validity_mask(motion))
    found = apply_st(rs, st)
    expected = unshutter.rectify(rs, motion=motion, edges="keep").array
    difference = np.abs(found.astype(int) - expected)[core(validity_mask(motion))]
    assert difference.mean() < 0.7
    assert difference.max() <= 10


def test_the_st_map_of_no_motion_is_the_ramp_that_nuke_users_write() -> None:
    """Red (x + 0.5) / width, green (y + 0.5) / height, y counted from the lowest row."""
    st = PixelMap.of(RowMotion.zero(3, 5)).st()
    assert st[2, 0, :2] == pytest.approx([0.1, 1 / 6])  # lower left
    assert st[0, 4, :2] == pytest.approx([0.9, 5 / 6])  # upper right
    assert (st[..., 2] == 1).all()


@pytest.mark.parametrize("readout", [*ScanDirection])
def test_map_and_inverse_undo_each_other(tmp_path: Path, readout: ScanDirection) -> None:
    motion = stored(tmp_path, shake(readout))
    assert main(["map", str(motion), "-o", str(tmp_path / "to.npz")]) == 0
    assert main(["map", str(motion), "-o", str(tmp_path / "back.npz"), "--inverse"]) == 0
    with np.load(tmp_path / "to.npz") as to, np.load(tmp_path / "back.npz") as back:
        there = [back[k] for k in ("map_x", "map_y")]
        again = [cv2.remap(to[k], *there, cv2.INTER_LINEAR) for k in ("map_x", "map_y")]
    row, col = np.mgrid[:HEIGHT, :WIDTH]
    inside = (there[0] >= 0) & (there[0] <= WIDTH - 1) & (there[1] >= 0) & (there[1] <= HEIGHT - 1)
    assert inside.mean() > 0.7
    assert np.abs(again[0] - col)[inside].max() < 0.06  # OpenCV's positions are good to 1/32 px
    assert np.abs(again[1] - row)[inside].max() < 0.06


def test_the_inverse_map_distorts(tmp_path: Path) -> None:
    """A bar drawn upright stands, after the inverse map, where t_x says."""
    gs = np.zeros((HEIGHT, WIDTH), np.uint8)
    gs[:, 100] = 200
    motion = RowMotion.from_polynomials([0, 20], [0, 0], HEIGHT, WIDTH)
    made = PixelMap.of(motion, inverse=True)
    rs = cv2.remap(gs, made.col, made.row, cv2.INTER_LINEAR)
    at = (rs * np.arange(float(WIDTH))).sum(1) / rs.sum(1)
    assert at == pytest.approx(100 + motion.tx_px, abs=0.1)


def test_a_photo_gives_the_map_of_its_estimate(tmp_path: Path, rolling_facade: np.ndarray) -> None:
    photo = tmp_path / "street.png"
    Photo.from_array(rolling_facade).save(photo)
    before = photo.read_bytes()
    arguments = ["--reference", "middle", "--readout", "bottom-to-top"]
    assert main(["map", str(photo), "-o", str(tmp_path / "m.npz"), *arguments]) == 0
    found = unshutter.estimate(photo, reference="middle", readout="bottom-to-top")
    expected = PixelMap.of(found.motion)
    with np.load(tmp_path / "m.npz") as maps:
        assert np.array_equal(maps["map_x"], expected.col)
        assert np.array_equal(maps["map_y"], expected.row)
    assert photo.read_bytes() == before


def test_maps_are_for_stored_pixels_whatever_the_orientation(tmp_path: Path, rolling_facade: np.ndarray) -> None:
    """As docs/guide/compositing says: read without turning, and the map fits."""
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(rolling_facade).save(tmp_path / "portrait.png", exif=exif)
    assert main(["map", str(tmp_path / "portrait.png"), "-o", str(tmp_path / "m.npz")]) == 0
    photo = cv2.imread(str(tmp_path / "portrait.png"), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    assert photo is not None and photo.shape == rolling_facade.shape
    with np.load(tmp_path / "m.npz") as maps:
        found = cv2.remap(photo, maps["map_x"], maps["map_y"], cv2.INTER_CUBIC)[..., ::-1]
    expected = unshutter.rectify(tmp_path / "portrait.png", edges="keep")
    difference = np.abs(found.astype(int) - expected.pixels)[core(expected.valid)]
    assert difference.mean() < 2  # drawn edges are hard, and the two cubics differ there
    assert np.abs(photo[..., ::-1].astype(int) - expected.pixels)[core(expected.valid)].mean() > 3 * difference.mean()


@pytest.mark.parametrize("readout", ["top-to-bottom", "right-to-left"])
def test_size_scales_the_map(tmp_path: Path, readout: str) -> None:
    motion = stored(tmp_path, shake(readout))
    small = map_file(motion, tmp_path / "small.npz", size=f"{WIDTH // 2}x{HEIGHT // 2}")
    assert small.motion.scan_direction.frame_size(small.motion.height, small.motion.width) == (HEIGHT // 2, WIDTH // 2)
    map_file(motion, tmp_path / "whole.npz")
    with np.load(tmp_path / "small.npz") as half, np.load(tmp_path / "whole.npz") as whole:
        for key in ("map_x", "map_y"):
            halved = cv2.resize(whole[key], (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA) / 2 - 0.25
            assert np.abs(half[key] - halved)[10:-10, 10:-10].max() < 0.05


def test_reference_of_a_motion_file(tmp_path: Path) -> None:
    source = stored(tmp_path, shake())
    assert map_file(source, tmp_path / "a.npz").motion.reference == "first"
    found = map_file(source, tmp_path / "b.npz", reference="middle")
    with np.load(tmp_path / "b.npz") as maps:
        assert np.abs(maps["map_x"][HEIGHT // 2] - np.arange(WIDTH)).max() < 0.01  # that row stays where it is
    assert found.motion.reference == "middle"


# ---- refused ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("m.png", {}, "must be one of .npz, .exr, .tif"),
        ("m", {}, "must be one of"),
        ("m.npz", {"size": "200"}, "write it like 1920x1080"),
        ("m.npz", {"size": "²x3"}, "write it like"),
        ("m.npz", {"size": "0x0"}, "1 to 1,000,000,000 pixels"),
        ("m.npz", {"size": "99999999x99999999"}, "1 to 1,000,000,000 pixels"),
        ("m.npz", {"size": "150x200"}, "aspect ratios differ"),
        ("m.npz", {"find": Find(camera=Camera("left-to-right"))}, "made for readout top-to-bottom"),
        ("no/m.npz", {}, "there is no folder"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path: Path, name: str, options: dict, message: str) -> None:
    with pytest.raises(UnshutterError) as error:
        map_file(stored(tmp_path, shake()), tmp_path / name, **options)
    assert message in one_line(error)
    assert [p.name for p in tmp_path.iterdir()] == ["motion.json"]


def test_existing_files_and_originals_stay(tmp_path: Path) -> None:
    source = stored(tmp_path, shake())
    (tmp_path / "m.npz").write_text("precious")
    with pytest.raises(UnshutterError, match="--overwrite"):
        map_file(source, tmp_path / "m.npz")
    assert (tmp_path / "m.npz").read_text() == "precious"
    map_file(source, tmp_path / "m.npz", overwrite=True)
    np.load(tmp_path / "m.npz").close()
    with pytest.raises(UsageError, match="extension"):
        map_file(source, source, overwrite=True)


def test_a_motion_that_folds_and_a_file_that_is_none(tmp_path: Path) -> None:
    rz = np.concatenate([np.zeros(50), np.full(50, 0.1)])
    with pytest.raises(UnshutterError, match="faster than rows are read"):
        map_file(stored(tmp_path, RowMotion(100, np.zeros(100), rz)), tmp_path / "m.npz")
    (tmp_path / "motion.json").write_text(json.dumps({"format": "something else"}))
    with pytest.raises(UnshutterError, match="not a motion file"):
        map_file(tmp_path / "motion.json", tmp_path / "m.npz")
    with pytest.raises(UnshutterError, match="No such file"):
        map_file(tmp_path / "none.json", tmp_path / "m.npz")


def test_exr_without_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "OpenEXR", None)
    with pytest.raises(UnshutterError) as error:
        map_file(stored(tmp_path, shake()), tmp_path / "m.exr")
    assert version.extra("exr") in one_line(error)
    assert not (tmp_path / "m.exr").exists()


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".npz"])
def test_a_map_that_the_system_refuses(tmp_path: Path, suffix: str) -> None:
    """The line names the map, not the temporary file; as on a full disc, writing fails in mid-file."""
    resource = pytest.importorskip("resource")
    if suffix == ".exr":
        pytest.importorskip("OpenEXR")
    source, target = stored(tmp_path, shake()), tmp_path / f"m{suffix}"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, before[1]))
    try:
        with pytest.raises(UnshutterError) as error:
            map_file(source, target)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert one_line(error) == f"cannot write {target}: File too large"
    assert [path.name for path in tmp_path.iterdir()] == ["motion.json"]


def test_what_is_known_of_the_camera_reaches_the_estimate(tmp_path: Path, rolling_facade: np.ndarray) -> None:
    photo = tmp_path / "photo.png"
    Photo.from_array(rolling_facade).save(photo)
    columns = []
    for flag, told in (
        ("--roll-deg", {"roll_deg": 4}),
        ("--tilt-deg", {"tilt_deg": 20}),
        ("--focal-px", {"focal_px": 300}),
    ):
        target = tmp_path / f"{flag}.npz"
        assert main(["map", str(photo), "-o", str(target), flag, str(*told.values())]) == 0
        columns.append(np.load(target)["map_x"])
        np.testing.assert_array_equal(columns[-1], PixelMap.of(unshutter.estimate(photo, **told).motion).col)
    assert (columns[0] != columns[1]).any() and (columns[1] != columns[2]).any()


@pytest.mark.parametrize("flag", ["--roll-deg", "--tilt-deg", "--focal-px"])
def test_a_motion_file_leaves_nothing_to_be_told(flag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion = stored(tmp_path, RowMotion.zero(80, 120))
    assert main(["map", str(motion), "-o", str(tmp_path / "m.npz"), flag, "4"]) == 2
    assert "leave them out" in capsys.readouterr().err and not (tmp_path / "m.npz").exists()
