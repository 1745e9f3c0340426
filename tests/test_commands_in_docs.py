"""Every command that README and docs show is run, in order, on stand-ins of the names that it names.

Those of the tutorial are run by tests/docs/test_printed_lines.py, which also checks what they print. Each command does
its whole work. Of a photo, the repository's example stands in; clips and bursts are drawn. A command that cannot run
here says why in ``SKIPPED``; those of unshutter are parsed all the same, so that an option that is gone shows.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from support import clips
from support.camera_files import dng, heic, linear
from support.gyro_logs import write_gcsv
from support.walking_camera import WalkingCamera
from unshutter.cli import command_named, main
from unshutter.cli.arguments import parse
from unshutter.motion import RowMotion
from unshutter.video.gyro.gyro_log import GyroLog

ROOT = Path(__file__).parent.parent
EXAMPLE, EXAMPLE_MOTION = ROOT / "examples" / "demo.jpg", ROOT / "examples" / "demo.motion.json"
_TUTORIAL = set(ROOT.glob("docs/tutorial/*.md"))
PAGES = sorted({ROOT / "README.md", ROOT / "examples" / "README.md", *ROOT.glob("docs/**/*.md")} - _TUTORIAL)
_BLOCK = re.compile(r"^( *)```(?:sh|bash|console|shell)\n(.*?)^\1```", re.MULTILINE | re.DOTALL)

# the beginning of a command -> why it is not run
SKIPPED = {
    "pip ": "installs packages, which .ci/release-check tries in environments of its own",
    "pipx ": "installs packages",
    "uvx ": "installs packages",
    "python3 -m venv ": "makes an environment, as .ci/release-check does",
    "make app": "builds for minutes: tests/release/test_application.py tries what was built",
    "python ": "measures for minutes; each of these scripts has tests of its own",
    'grep \'"event": "failed"\'': "finds nothing where nothing failed",
    "ffmpeg ": "is another program",
    "oiiotool ": "is another program",
    "colmap ": "is another program",
    "docker ": "is another program",
    "dask ": "starts a cluster: tests/run/test_cluster.py does",
    "unshutter serve": "runs until it is stopped: tests/page does",
    "unshutter open": "starts a page that stays: tests/page does",
    "unshutter rectify s3://": "needs a store: tests/run/test_urls.py uses one in memory",
    "unshutter rectify /photos": "needs a cluster: tests/run/test_cluster.py has one",
    "unshutter train": "trains for hours: lab/tests/training trains a little",
    "unshutter calibrate": "measures for hours: lab/tests/calibration calibrates a little",
    "unshutter evaluate": "measures on pictures that are not in the repository: lab/tests/evaluation draws some",
    "unshutter synthesize photos/ -o pairs/ --motion trajectory": "needs a recorded trajectory: lab/tests/synthesis",
    "unshutter synthesize house.jpg -o film/": "needs a recorded trajectory: lab/tests/synthesis",
    "unshutter video ride.mp4": "needs the calibration of a lens: tests/video/calibrate/test_lenses.py writes some",
    "unshutter rectify street.jpg --estimator kandula2020@runs": "needs a trained network",
    "unshutter rectify street.jpg --estimator kandula2020-research@runs": "needs a trained network",
}
_EXTRAS = {".exr": "OpenEXR", "--plot": "matplotlib", " video ": "av", ".HEIC": "pi_heif", ".NEF": "rawpy"}
_OF_LAB = ("synthesize", "train", "evaluate", "calibrate", "kandula2020-research")


def commands(page: Path) -> Iterator[str]:
    """The commands of a page, each a line, without remarks."""
    for _, block in _BLOCK.findall(page.read_text(encoding="utf-8")):
        for line in block.replace("\\\n", " ").splitlines():
            command = re.sub(r"\s+#.*", "", line.strip())
            if command and not command.startswith("#"):
                yield command


SHOWN = {page: list(commands(page)) for page in PAGES}


def test_all_pages_with_commands_are_looked_at() -> None:
    assert sum(map(len, SHOWN.values())) > 80
    unused = [start for start in SKIPPED if not any(one.startswith(start) for each in SHOWN.values() for one in each)]
    assert not unused


@pytest.mark.thorough
@pytest.mark.parametrize(
    "page", [page for page in PAGES if SHOWN[page]], ids=lambda page: page.relative_to(ROOT).as_posix()
)
def test_commands_of(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for command in SHOWN[page]:
        _prepare(command)
        if reason := _cannot_run(command):
            print(f"not run: {command} ({reason})")
        else:
            code = _run(command, capsys)
            assert code == 0, f"{page.name}: {command}: {capsys.readouterr().err}"


@pytest.mark.parametrize("page", [*PAGES, *sorted(_TUTORIAL)], ids=lambda page: page.stem)
def test_the_options_of_a_page_exist(page: Path) -> None:
    for command in commands(page):
        if command.startswith("unshutter "):
            name, *words = shlex.split(re.split(" [<>] ", command)[0].removesuffix(" &"))[1:]
            if find_spec("unshutter_lab") or name not in _OF_LAB:
                parse(name, command_named(name), words)


def _cannot_run(command: str) -> str:
    for start, reason in SKIPPED.items():
        if command.startswith(start):
            return reason
    missing = [package for sign, package in _EXTRAS.items() if sign in command and find_spec(package) is None]
    if find_spec("unshutter_lab") is None and any(word in command for word in _OF_LAB):
        missing.append("unshutter-lab")
    return f"needs {', '.join(missing)}" if missing else ""


def _run(command: str, capsys: pytest.CaptureFixture[str]) -> int:
    """Runs a command, as a shell would; the exit code."""
    if not command.startswith("unshutter ") or " < " in command or " - " in command:
        here = {**os.environ, "PATH": os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))}
        return subprocess.run(["bash", "-c", command], check=False, capture_output=True, env=here).returncode
    command, _, target = command.partition(" > ")
    capsys.readouterr()
    code = main(shlex.split(command)[1:])
    if target:
        path = Path(target).expanduser()
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(capsys.readouterr().out)
    return code


# ---- stand-ins -------------------------------------------------------------------------------------------------

_WRITTEN = ("-o", "--save-motion", "--save-gyro", "--masks", "--json-log", "--plot", "--preview")


def _prepare(command: str) -> None:
    """Makes what a command reads, where it is not there, and removes a file that it writes: pages show alternatives."""
    for pattern in ("*.rectified.*", "unshutter-manifest.jsonl"):
        for path in Path().rglob(pattern):
            path.unlink()
    before = command.partition(" > ")[0].replace("cat ", "unshutter rectify ")
    words = [word for word in shlex.split(before)[2:] if word not in "<|-"] if before.startswith("unshutter ") else []
    written = {words[k + 1] for k, word in enumerate(words[:-1]) if word in _WRITTEN}
    for word in words:
        path = Path(word)
        if word in written:
            if path.is_file() and "--overwrite" not in words:
                path.unlink()
        elif (path.suffix == ".mp4" and {"--start", "--camera"} & set(words)) or not (
            path.exists() or "://" in word or word.startswith(("-", "/"))
        ):
            _make(path, word, command)


def _make(path: Path, word: str, command: str) -> None:
    """Makes a file or folder by its name."""
    makers = {
        "examples": lambda: Path("examples").symlink_to(ROOT / "examples"),
        "frames": lambda: _frames(Path("frames")),
        "straight": lambda: _frames(Path("straight")),
        "sparse": lambda: WalkingCamera(numbers=(0, 3, 6)).write_model(path),
        "film": lambda: _frames(Path("film")),
        "FOLDER": lambda: _folder(path) if word.endswith("/") else None,
        **dict.fromkeys(("a.jpg", "b.jpg", "c.jpg"), _burst),
        ".mp4": lambda: _clip(path, command),
        ".json": lambda: _wide_motion(path) if "--size" in command else shutil.copy(EXAMPLE_MOTION, path),
        ".gcsv": lambda: write_gcsv(path, GyroLog(*_gyro_samples(), "a test", np.zeros((0, 4)))),
        ".csv": lambda: path.write_text("x,y\n10,20\n30,40.5\n"),
        ".HEIC": lambda: path.write_bytes(heic(_pixels())),
        ".NEF": lambda: path.write_bytes(dng(linear(_pixels()))),
        ".jpg": lambda: shutil.copy(EXAMPLE, path),
    }
    for name in (path.parts[0], path.name, path.suffix or "FOLDER"):
        if name in makers:
            makers[name]()
            return


def _gyro_samples() -> tuple[np.ndarray, np.ndarray]:
    """Ten seconds of a camera that pans slowly: times [s] and rates [rad/s]."""
    times = np.arange(0, 10, 0.005)
    return times, np.outer(np.sin(times), [0.0, 0.1, 0.0])


def _pixels() -> np.ndarray:
    return np.asarray(Image.open(EXAMPLE).convert("RGB"))


def _folder(path: Path) -> None:
    """Two photos, of which one shows no motion."""
    path.mkdir()
    shutil.copy(EXAMPLE, path / "one.jpg")
    Image.fromarray(np.full((300, 400, 3), 128, np.uint8)).save(path / "two.jpg")


def _burst() -> None:
    _frames(Path("burst"))
    for name, frame in zip(("a.jpg", "b.jpg", "c.jpg"), sorted(Path("burst").iterdir()), strict=False):
        Image.open(frame).save(name, quality=95)


def _frames(folder: Path) -> None:
    """Frames of a camera that turns, as numbered pictures."""
    folder.mkdir(exist_ok=True)
    for k, grey in enumerate(clips.moving(6)[1]):
        Image.fromarray(grey).convert("RGB").save(folder / f"{k:05}.png")


def _clip(path: Path, command: str) -> None:
    """A clip: for ``--camera`` one of that camera's size and rate, for ``--start`` one that is long enough."""
    frames = 60 if "--save-motion" in command else 22 if "--start" in command else 10
    pictures, times = clips.moving(frames)[1], None
    with pytest.MonkeyPatch.context() as patch:
        if "--camera" in command:
            patch.setattr(clips, "FPS", 25)
            pictures = [cv2.resize(grey, (1920, 1080)) for grey in pictures[:3]]
        if "--start" in command:
            times = range(len(pictures))  # a frame a second
        clips.write(path, pictures, times=times)


def _wide_motion(path: Path) -> None:
    RowMotion.from_polynomials([0, 6, -9], [0, 0.05], 1080, 1920).save(path)
