"""The application to double-click, where `make app` has built it: in an environment that has no Python, nor a PATH."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import httpx
import numpy as np
import pytest

from support import clips
from support.camera_files import heic
from support.connections import Watch, strace_works
from support.page_server import LONG_S, becomes, events, opened, run_command, temporary_folders
from support.page_user import User, alive, user_in
from unshutter.page.instance import described_page

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "dist" / "app" / "unshutter"
PROGRAM = FOLDER / "unshutter"
LARGEST_MB = 350
built = pytest.mark.skipif(not PROGRAM.is_file(), reason="the application is not here: make app")


@pytest.fixture
def user(tmp_path: Path) -> Iterator[User]:
    with user_in(tmp_path / "user", program=[str(PROGRAM)], others={}) as user:
        yield user


@pytest.mark.parametrize(
    ("words", "command"),
    [
        ([], ["open"]),
        (["a.jpg", "b.mp4"], ["open", "a.jpg", "b.mp4"]),
        (["rectify", "a.jpg"], ["rectify", "a.jpg"]),
        (["--version"], ["--version"]),
    ],
)
def test_files_are_opened_and_commands_are_understood(words: list[str], command: list[str]) -> None:
    spec = spec_from_file_location("start", ROOT / "application" / "start.py")
    assert spec is not None and spec.loader is not None
    start = module_from_spec(spec)
    spec.loader.exec_module(start)
    assert start.command(words) == command


@built
def test_it_opens_photos_and_clips_stops_and_starts_again(user: User, photo: Path, tmp_path: Path) -> None:
    iphones = tmp_path / "IMG_1.HEIC"
    iphones.write_bytes(heic(np.full((300, 400, 3), 128, np.uint8)))
    clip = clips.write(tmp_path / "walk.mkv", clips.moving(12)[1], "ffv1")
    started = user.open(photo, iphones, clip)
    assert (started.returncode, started.stdout, started.stderr) == (0, "", "")
    page = user.page
    with user.client() as client:
        (tab,) = user.tabs
        assert client.get(f"/api/tabs/{tab}/files").json() == [photo.name, iphones.name, clip.name]
        run_command("rectify", photo, "-o", tmp_path / "expected.jpg")
        picture = client.get(f"/api/photos/{opened(client, photo)}/picture")
        assert picture.content == (tmp_path / "expected.jpg").read_bytes()
        grey = client.get(f"/api/photos/{opened(client, iphones)}/before")
        assert grey.status_code == 200 and grey.content.startswith(b"\xff\xd8")
        run_command("video", clip, "-o", tmp_path / "expected.mkv", "--readout-ratio", "0.6")
        assert saved_clip(client, clip) == (tmp_path / "expected.mkv").read_bytes()
        with client.stream("GET", "/api/tabs"):
            pass  # a tab that is closed at once
    assert becomes(lambda: not alive(page.pid))
    assert described_page(user.folder) is None and not temporary_folders(user.home)
    assert user.open().returncode == 0
    assert user.page.pid != page.pid and len(user.links) == 2


def saved_clip(client: httpx.Client, clip: Path) -> bytes:
    """What the page saves of a clip."""
    name = {"Unshutter-Name": clip.name}
    id = client.post("/api/clips", content=clip.read_bytes(), headers=name).json()["id"]
    wishes = {"to": "file", "photos": [{"id": id, "options": {"readout-ratio": "0.6"}}]}
    saving = client.post("/api/saves", json=wishes).json()["id"]
    assert list(events(client, saving))[-1]["state"] == "finished"
    return client.get(f"/api/saves/{saving}/file").content


@built
def test_what_cannot_be_opened_is_shown_in_the_browser(user: User, tmp_path: Path) -> None:
    refused = user.open(tmp_path / "no<b>.jpg")
    assert refused.returncode == 1 and "there is no file" in refused.stderr and refused.stderr.count("\n") == 1
    (shown,) = user.home.glob("*.seen")
    assert f"there is no file {tmp_path}/no&lt;b&gt;.jpg" in shown.read_text()


@built
def test_a_clip_is_straightened_with_its_encoders(user: User, tmp_path: Path) -> None:
    _, frames = clips.moving(16)
    clip = clips.write(tmp_path / "walk.mp4", frames)
    for codec in ("h264", "hevc", "av1"):
        out = tmp_path / f"{codec}.mp4"
        done = user.open("video", clip, "-o", out, "--readout-ratio", "0.6", "--codec", codec)
        assert done.returncode == 0 and out.stat().st_size > 1000, done.stderr


@built
def test_all_extras_are_in_it(user: User, photo: Path, tmp_path: Path) -> None:
    assert user.open("map", photo, "-o", tmp_path / "map.exr").returncode == 0
    plotted = user.open("estimate", photo, "-o", tmp_path / "motion.json", "--plot", tmp_path / "plot.png")
    assert plotted.returncode == 0 and (tmp_path / "plot.png").stat().st_size > 1000, plotted.stderr
    unreachable = user.open("rectify", photo, photo, "-o", tmp_path, "--scheduler", "tcp://127.0.0.1:9")
    assert "cannot reach the Dask scheduler" in unreachable.stderr
    raw = tmp_path / "empty.dng"
    raw.write_bytes(b"II*\0" + bytes(100))
    assert "pip install" not in user.open("rectify", raw).stderr
    assert user.open("cameras", "GoPro").stdout.count("\n") > 10


@built
def test_its_browser_gets_the_libraries_of_the_system_and_its_page_its_own(user: User) -> None:
    assert user.open().returncode == 0
    assert (user.home / "environment").read_text() == "LD_LIBRARY_PATH=\n"
    mapped = set(re.findall(r"/\S+/libssl\S+", Path(f"/proc/{user.page.pid}/maps").read_text()))
    assert mapped and all(Path(each).is_relative_to(FOLDER) for each in mapped)
    assert {each.name for each in user.home.iterdir()} <= {
        *("browser", "environment", "opened", "unshutter"),
        *(each.name for each in temporary_folders(user.home)),
    }


@built
def test_it_talks_to_nobody(user: User, photo: Path, tmp_path: Path) -> None:
    if not strace_works():
        pytest.skip("strace is not installed, or not allowed to watch")
    (tmp_path / "watch").mkdir()
    watch = Watch(tmp_path / "watch", True)
    program = "import ast, os, sys; os.execve(sys.argv[2], sys.argv[2:], ast.literal_eval(sys.argv[1]))"
    watched = watch.start("-c", program, repr(user.environment), PROGRAM, photo)
    assert becomes(lambda: bool(user.links))
    with user.client() as client:
        assert client.get(f"/api/photos/{opened(client, photo)}/picture").status_code == 200
        with client.stream("GET", "/api/tabs"):
            pass
    assert watched.wait(LONG_S) == 0
    assert watch.seen_elsewhere() == []


@built
def test_its_size() -> None:
    size = sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file() and not path.is_symlink())
    assert size < LARGEST_MB * 1_000_000


@built
def test_licences_are_in_it() -> None:
    notice = (FOLDER / "NOTICE.txt").read_text(encoding="utf-8")
    assert "GNU General Public License, version 3 or later (licences/GPL-3.0.txt)" in notice
    assert "TERMS AND CONDITIONS" in (FOLDER / "licences" / "GPL-3.0.txt").read_text()
    listed = re.findall(r"^(\S+) ([0-9]\S*): (.+)$", notice, re.MULTILINE)
    packages = {name: terms for name, _, terms in listed}
    assert {"unshutter", "av", "numpy", "opencv-python-headless", "pyvips-binary", "pi_heif", "rawpy", "Python"} <= set(
        packages
    )
    for name, version, terms in listed:
        texts = [FOLDER / "licences" / f"{name}-{version}", FOLDER / "licences" / f"{name}.txt"]
        assert "no text" in terms or any(each.exists() for each in texts), name
    assert [name for name, terms in packages.items() if re.search(r"(?<!L)GPL", terms)] == ["av"]
    assert not list(FOLDER.rglob("*readline*")), "it is under the GPL"


@built
@pytest.mark.skipif(sys.platform != "linux", reason="menus of Linux desktops")
def test_it_is_added_to_the_menu(user: User, photo: Path) -> None:
    applications = user.home / "share" / "applications"
    added = user.run(FOLDER / "add-to-menu", XDG_DATA_HOME=str(user.home / "share"), PATH=os.defpath)
    assert added.returncode == 0 and str(applications) in added.stdout
    (entry,) = applications.glob("*.desktop")
    program = re.search(r'^Exec="(.+)" %F$', entry.read_text(), re.MULTILINE)
    assert program is not None and Path(program[1]) == PROGRAM
    icon = re.search(r"^Icon=(.+)$", entry.read_text(), re.MULTILINE)
    assert icon is not None and Path(icon[1]).is_file()
    validator = shutil.which("desktop-file-validate")
    if validator is not None:
        done = subprocess.run([validator, entry], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (0, "")
