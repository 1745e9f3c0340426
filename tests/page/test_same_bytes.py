"""One photo or clip, one result: the page, the command line and Python write the same bytes, whatever the format."""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image

import unshutter
from support import clips
from support.page_server import opened, run_command, zipped
from support.rich_files import exif


@pytest.fixture(scope="module")
def photos(
    tmp_path_factory: pytest.TempPathFactory, rolling_facade: np.ndarray, basilica: tuple[np.ndarray, object]
) -> list[Path]:
    """Photos of every format that is written; one of them does not change."""
    folder = tmp_path_factory.mktemp("photos")
    picture, far = Image.fromarray(rolling_facade), Image.fromarray(basilica[0])
    seen = Image.fromarray(np.broadcast_to(np.arange(560, dtype=np.uint8) // 4 + 115, (420, 560)).copy())
    save: dict[str, Callable[[Path], object]] = {
        "plain.jpg": lambda path: picture.save(path, quality=92, subsampling=0),
        "turned.jpg": lambda path: far.transpose(Image.Transpose.FLIP_LEFT_RIGHT).save(path, exif=exif(2), quality=95),
        "grey.jpg": lambda path: picture.convert("L").save(path),
        "eight.png": picture.save,
        "alpha.png": lambda path: _with_alpha(picture, seen).save(path),
        "sixteen.png": lambda path: _write_deep(path, rolling_facade),
        "plain.webp": lambda path: picture.save(path, quality=90),
        "plain.tif": picture.save,
        "plain.avif": lambda path: picture.save(path, quality=90),
        "far.jpg": lambda path: far.save(path, quality=95),
        "still.jpg": lambda path: Image.new("RGB", (400, 300), "grey").save(path),
    }
    for name, write in save.items():
        write(folder / name)
    return [folder / name for name in save]


def _with_alpha(picture: Image.Image, alpha: Image.Image) -> Image.Image:
    copy = picture.copy()
    copy.putalpha(alpha)
    return copy


def _write_deep(path: Path, pixels: np.ndarray) -> None:
    import cv2

    cv2.imwrite(str(path), pixels[..., ::-1].astype(np.uint16) * 257)


def _from_the_page(client: httpx.Client, ids: list[str], options: dict[str, str]) -> dict[str, bytes]:
    """Returns the files of a zip file of all, by name."""
    done, packed = zipped(client, [{"id": id, "options": options} for id in ids])
    assert not [each for each in done if "error" in each], done
    return {name: packed.read(name) for name in packed.namelist()}


def _written(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir() if not file.name.startswith("unshutter-")}


def _no_corner_is_black(file: bytes) -> bool:
    pixels = np.asarray(Image.open(BytesIO(file)).convert("RGB")).astype(int).sum(axis=-1)
    return all(pixels[row, col] > 30 for row in (0, -1) for col in (0, -1))


def test_photos(client: httpx.Client, photos: list[Path], tmp_path: Path) -> None:
    on_page = _from_the_page(client, [opened(client, photo) for photo in photos], {})
    log = tmp_path / "log.jsonl"
    run_command("rectify", *photos, "-o", tmp_path / "commands", "--each-alone", "--json-log", log)
    (tmp_path / "python").mkdir()
    for photo in photos[::2]:  # formats are the business of functions that the command line calls, too
        result = unshutter.rectify(photo)
        name = f"{photo.stem}.rectified{photo.suffix}" if result.changed else photo.name
        result.save(tmp_path / "python" / name)
    commands, python = _written(tmp_path / "commands"), _written(tmp_path / "python")
    assert sorted(on_page) == sorted(commands) and len(python) == 6
    assert [name for name, content in on_page.items() if content != commands[name]] == []
    assert [name for name, content in python.items() if content != commands[name]] == []
    changed = [name for name in on_page if ".rectified." in name]
    assert len(changed) == len(photos) - 1 and on_page["still.jpg"] == photos[-1].read_bytes()
    assert all(_no_corner_is_black(on_page[name]) for name in changed)
    told = log.read_text()
    assert '"edges": "crop"' in told and '"edges": "fill"' not in told


@pytest.mark.thorough
def test_a_batch_and_a_cluster(photos: list[Path], tmp_path: Path) -> None:
    """Worker processes, here or on other machines, write what one process writes."""
    distributed = pytest.importorskip("distributed", reason="needs unshutter[dask]")
    few = [photo for photo in photos if photo.stem in ("plain", "far", "still")]
    each_alone = [*few, "--each-alone", "-o"]
    run_command("rectify", *each_alone, tmp_path / "one", "--jobs", 1)
    run_command("rectify", *each_alone, tmp_path / "batch", "--jobs", 2)
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0")
    with cluster:
        run_command("rectify", *each_alone, tmp_path / "cluster", "--scheduler", cluster.scheduler_address)
    by_one = _written(tmp_path / "one")
    assert len(by_one) == len(few) == 6
    assert by_one == _written(tmp_path / "batch")
    assert by_one == _written(tmp_path / "cluster")


def test_clips(client: httpx.Client, tmp_path: Path) -> None:
    originals, commands, python = (tmp_path / name for name in ("clips", "commands", "python"))
    for folder in (originals, commands, python):
        folder.mkdir()
    moving = clips.moving(12)[1]
    videos = [
        clips.write(originals / "walk.mkv", moving, "ffv1", sound=True),
        clips.write(originals / "walk.mov", moving, "prores_ks", "yuv422p10le"),
        clips.write(originals / "still.mkv", clips.standing(8), "ffv1"),
    ]
    ids = [opened(client, video, "clips") for video in videos]
    for video in videos:
        run_command("video", video, "-o", commands / video.name, *clips.KNOWN)
        unshutter.rectify_clip(str(video), str(python / video.name), readout_ratio=clips.RATIO, focal_px=clips.FOCAL)
    on_page = _from_the_page(client, ids, {"readout-ratio": str(clips.RATIO), "focal-px": str(clips.FOCAL)})
    assert list(on_page) == ["walk.rectified.mkv", "walk.rectified.mov", "still.mkv"]
    for video, content in zip(videos, on_page.values(), strict=True):
        assert content == (commands / video.name).read_bytes() == (python / video.name).read_bytes()
        assert (content == video.read_bytes()) == (video.stem == "still")
