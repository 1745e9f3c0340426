"""No process of ours talks to anybody but this computer.

Each program lives some seconds here. SILENCE_S=30 lets it live as long as a telemetry client may wait:

    SILENCE_S=30 python -m pytest tests/test_silence.py --durations=0
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

from support.connections import Watch, strace_works
from unshutter.photo import Photo

LIFE_S = float(os.environ.get("SILENCE_S", "1"))
TOKEN = "test-token"

LIVES_ON = """
import sys, time, unshutter
for estimator in ("segment-manhattan", "kandula2020", "kandula2020-research"):
    unshutter.rectify(sys.argv[1], estimator=estimator)
time.sleep(float(sys.argv[2]))
"""


@pytest.fixture
def watch(tmp_path: Path) -> Watch:
    """The better one of the two that this system allows."""
    (tmp_path / "watch").mkdir()
    return Watch(tmp_path / "watch", strace_works())


@pytest.mark.parametrize("with_strace", [True, False])
def test_the_watch_sees_whom_a_program_talks_to(with_strace: bool, tmp_path: Path) -> None:
    """Here an address for documentation, to which UDP connects without sending anything."""
    if with_strace and not strace_works():
        pytest.skip("strace is not installed, or not allowed to watch")
    watch = Watch(tmp_path, with_strace)
    talk = "import socket as s; s.socket(s.AF_INET, s.SOCK_DGRAM).connect((address, 9))"
    program = f"import subprocess, sys; address = sys.argv[1]; {talk}"
    for address in ("127.0.0.1", "192.0.2.1"):
        child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {program!r}, {address!r}])"
        assert watch.start("-c", child).wait(60) == 0
        assert watch.seen_elsewhere() == ([] if address == "127.0.0.1" else ["192.0.2.1"])


def test_a_python_process_talks_to_nobody(watch: Watch, photo: Path) -> None:
    assert watch.start("-c", LIVES_ON, photo, LIFE_S).wait(120 + LIFE_S) == 0
    assert watch.seen_elsewhere() == []


def test_a_batch_talks_to_nobody(watch: Watch, rolling_facade, tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for k in range(3 if LIFE_S < 10 else 40):
        Photo.from_array(rolling_facade).save(folder / f"{k}.jpg")
    words = ["-m", "unshutter", "rectify", folder, "-o", tmp_path / "out", "--jobs", 2]
    process = watch.start(*words, stderr=subprocess.PIPE)
    assert process.communicate(timeout=300) and process.returncode == 0
    assert len(list((tmp_path / "out").glob("*.jpg"))) == len(list(folder.iterdir()))
    assert watch.seen_elsewhere() == []


@pytest.mark.skipif(sys.platform == "win32", reason="ends a group of processes as POSIX has them")
def test_the_page_talks_to_nobody(watch: Watch, photo: Path) -> None:
    words = ["-m", "unshutter", "serve", "--port", 0, "--token", TOKEN]
    process = watch.start(*words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)
    try:
        assert process.stdout is not None
        url = process.stdout.readline().split()[1].partition("/?")[0]
        with httpx.Client(base_url=url, headers={"Authorization": f"Bearer {TOKEN}"}, timeout=60) as client:
            assert client.get("/").status_code == 200
            data = photo.read_bytes()
            answer = client.post("/api/photos", content=data, headers={"Unshutter-Name": "street.jpg"})
            one = {"id": answer.json()["id"], "options": {}}
            assert client.post("/api/saves", json={"to": "file", "photos": [one]}).is_success
        time.sleep(LIFE_S)
        assert process.poll() is None
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.communicate(timeout=60)
    assert watch.seen_elsewhere() == []
