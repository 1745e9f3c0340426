"""Tables of points moved between a photo and its rectified picture."""

from pathlib import Path

import numpy as np
import pytest

from support.covering import covering
from support.drawn_photos import one_line
from unshutter import Motion, RowMotion, ScanDirection, UnshutterError
from unshutter.cli import main
from unshutter.export import PixelMap, PointTable, move_file, move_points
from unshutter.motion import RotationMotion

HEIGHT, WIDTH = 300, 400


def shake(readout: str = "top-to-bottom") -> Motion:
    direction = ScanDirection(readout)
    height, width = direction.frame_size(HEIGHT, WIDTH)
    return RowMotion.from_polynomials([0, 30, -12], [0, -0.02, 0.06], height, width, scan_direction=direction)


def positions(path: Path) -> np.ndarray:
    return np.stack(PointTable.read(path).positions, axis=-1)


def turning(readout: str) -> RotationMotion:
    """A camera that turns about all three axes."""
    direction = ScanDirection(readout)
    height, width = direction.frame_size(HEIGHT, WIDTH)
    rotations = np.radians([[1.0, 3.0, 2.0]]) * np.linspace(0, 1, height)[:, None]
    return RotationMotion(width, scan_direction=direction, rotations=rotations, focal_px=420)


@pytest.fixture
def points(tmp_path: Path) -> Path:
    """A table of 200 points with names, x and y in the middle."""
    rng = np.random.default_rng(1)
    lines = [f"p{k},{x:.3f},{y:.3f},0.5" for k, (x, y) in enumerate(rng.uniform(0, (WIDTH, HEIGHT), (200, 2)))]
    path = tmp_path / "in.csv"
    path.write_text("\n".join(["name,X, y ,score", *lines]) + "\n")
    return path


@pytest.mark.parametrize(("kind", "readout"), covering([shake, turning], [*ScanDirection]))
def test_there_and_back(tmp_path: Path, points: Path, readout: ScanDirection, kind) -> None:
    motion, gs, rs = tmp_path / "m.json", tmp_path / "gs.csv", tmp_path / "rs.csv"
    kind(readout).save(motion)
    assert main(["points", str(motion), str(points), "-o", str(gs)]) == 0
    assert main(["points", str(motion), str(gs), "-o", str(rs), "--inverse"]) == 0
    assert np.abs(positions(rs) - positions(points)).max() < 0.01
    assert np.abs(positions(gs) - positions(points)).mean() > 1


@pytest.mark.parametrize(("kind", "readout"), covering([shake, turning], [*ScanDirection]))
def test_points_agree_with_the_maps(readout: ScanDirection, kind) -> None:
    """The map that rectifies says for every GS pixel where it is in the photo, as do points moved with inverse."""
    motion, rng = kind(readout), np.random.default_rng(2)
    col, row = rng.integers(0, WIDTH, 500), rng.integers(0, HEIGHT, 500)
    for inverse in (False, True):
        found = move_points(motion, col, row, inverse)
        expected = PixelMap.of(motion, inverse=not inverse)
        seen = expected.valid[row, col]
        assert np.abs(found[0] - expected.col[row, col])[seen].max() < 0.02
        assert np.abs(found[1] - expected.row[row, col])[seen].max() < 0.02


def test_signs() -> None:
    """t_x > 0 has moved the scene to the right, so a point of the photo belongs further left."""
    motion = RowMotion.from_polynomials([0, 30], [0, 0], HEIGHT, WIDTH)
    x, y = move_points(motion, np.array([200.0]), np.array([299.0]))
    assert (x[0], y[0]) == pytest.approx((170, 299))


def test_other_columns_and_the_header_stay(tmp_path: Path, points: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shake().save(tmp_path / "m.json")
    assert main(["points", str(tmp_path / "m.json"), str(points), "-o", str(tmp_path / "out.csv")]) == 0
    before = [line.split(",") for line in points.read_text().splitlines()]
    after = [line.split(",") for line in (tmp_path / "out.csv").read_text().splitlines()]
    assert after[0] == before[0]
    assert [(a[0], a[3]) for a in after] == [(b[0], b[3]) for b in before]
    assert "200 points" in capsys.readouterr().err


def test_without_a_header_the_first_two_columns_are_x_and_y(tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text('10,20,"a, quoted"\n\n30,40,b\n')
    total, unseen = move_file(RowMotion.zero(HEIGHT, WIDTH), tmp_path / "in.csv", tmp_path / "out.csv")
    assert (total, unseen) == (2, 0)
    assert (tmp_path / "out.csv").read_text() == '10.0000,20.0000,"a, quoted"\n30.0000,40.0000,b\n'


def test_what_spreadsheets_write(tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_bytes(b"\xef\xbb\xbfx,y\r\n1,2\r\n")
    assert positions(tmp_path / "in.csv").tolist() == [[1, 2]]


def test_the_first_pixel_of_colmap(tmp_path: Path) -> None:
    motion = shake()
    (tmp_path / "cv.csv").write_text("x,y\n100,200\n")
    (tmp_path / "colmap.csv").write_text("x,y\n100.5,200.5\n")
    move_file(motion, tmp_path / "cv.csv", tmp_path / "a.csv")
    move_file(motion, tmp_path / "colmap.csv", tmp_path / "b.csv", first_pixel=0.5)
    assert positions(tmp_path / "b.csv") == pytest.approx(positions(tmp_path / "a.csv") + 0.5)


def test_points_outside_the_photo_are_counted(tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text("x,y\n-3,10\n10,10\n10,5000\n")
    assert move_file(shake(), tmp_path / "in.csv", tmp_path / "out.csv") == (3, 2)
    assert move_file(shake(), tmp_path / "in.csv", tmp_path / "back.csv", inverse=True)[1] >= 2


def test_the_photo_ends_half_a_pixel_beyond_the_centres_of_its_outermost_pixels(tmp_path: Path) -> None:
    corners = f"-0.5,-0.5\n{WIDTH - 0.5},{HEIGHT - 0.5}\n"
    outside = f"-0.6,3\n3,-0.6\n{WIDTH - 0.4},3\n3,{HEIGHT - 0.4}\n"
    (tmp_path / "in.csv").write_text(f"x,y\n{corners}{outside}")
    assert move_file(RowMotion.zero(HEIGHT, WIDTH), tmp_path / "in.csv", tmp_path / "out.csv") == (6, 4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "it has no points"),
        (b"\n\n", "it has no points"),
        (b"x,z\n1,2\n", "name the columns x and y"),
        (b"x;y\n1;2\n", "separated by commas"),
        (b"x,y,x\n1,2,3\n", "once each"),
        (b"x,y\n1,2\n3\n", "line 3: 1 columns where the first line has 2"),
        (b"x,y\n1,two\n", "line 2: y is 'two', not a number"),
        (b"x,y\n1,nan\n", "line 2: y is 'nan', not a number"),
        (b"1,2\n,2\n", "line 2: x is '', not a number"),
        (b'x,y\n1,"two\nlines"\n', "line 3: y is 'two\\nlines', not a number"),
        (b"x,y\n\xff\xfe,1\n", "not a CSV text file"),
        (b"x,y\n\x00,1\n", "line 2"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "not a CSV text file"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "in.csv").write_bytes(content)
    with pytest.raises(UnshutterError) as error:
        move_file(shake(), tmp_path / "in.csv", tmp_path / "out.csv")
    assert message in one_line(error)
    assert not (tmp_path / "out.csv").exists()


def test_files_that_are_missing_exist_or_are_the_same(tmp_path: Path, points: Path) -> None:
    with pytest.raises(UnshutterError, match="No such file"):
        move_file(shake(), tmp_path / "none.csv", tmp_path / "out.csv")
    (tmp_path / "out.csv").write_text("precious")
    with pytest.raises(UnshutterError, match="--overwrite"):
        move_file(shake(), points, tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text() == "precious"
    with pytest.raises(UnshutterError, match="never overwritten"):
        move_file(shake(), points, points, overwrite=True)


def test_a_header_alone_is_a_table_of_no_points(tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text("x,y\n")
    assert move_file(shake(), tmp_path / "in.csv", tmp_path / "out.csv") == (0, 0)
    assert (tmp_path / "out.csv").read_text() == "x,y\n"


def test_the_motion_is_never_the_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion, table = tmp_path / "motion.json", tmp_path / "points.csv"
    shake().save(motion)
    table.write_text("1,2\n")
    before = motion.read_bytes()
    assert main(["points", str(motion), str(table), "-o", str(motion), "--overwrite"]) == 1
    assert "never overwritten" in capsys.readouterr().err
    assert motion.read_bytes() == before
