"""The server as a process: how it starts, and what is left when it ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from support.page_server import Server, becomes, opened, part, rss, served, start, temporary_folders

MB = 1_000_000


def _refusal(home: Path, *arguments: object) -> tuple[int, str]:
    process = start(home, *arguments)
    out, _ = process.communicate(timeout=20)
    return process.returncode, out


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["--host", "0.0.0.0"], 2, "add --i-know"),
        (["--token", "short"], 2, "--token needs at least 8 characters"),
        (["--port", "99999"], 2, "--port must lie between"),
        (["--max-mb", "0"], 2, "--max-mb must lie between"),
        (["--folder", "/no/such/folder"], 1, "there is no folder"),
        (["--host", "no.such.host.invalid", "--i-know"], 1, "cannot listen on"),
    ],
)
def test_starts_that_are_refused(tmp_path: Path, arguments: list[str], code: int, told: str) -> None:
    returned, out = _refusal(tmp_path / "home", *arguments)
    assert returned == code and told in out and out.count("\n") == 1, out


def test_a_port_that_is_taken(server: Server, tmp_path: Path) -> None:
    code, out = _refusal(tmp_path / "home", "--port", server.port)
    assert code == 1 and "Address already in use; --port 0" in out and out.count("\n") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_nothing_is_left(tmp_path: Path, photo: Path, number: int) -> None:
    home = tmp_path / "home"
    with served(home) as server, server.client() as client:
        opened(client, photo)
        assert client.post("/api/rectify", files=part(photo)).status_code == 200
        workers = Path(f"/proc/{server.process.pid}/task/{server.process.pid}/children").read_text().split()
        assert temporary_folders(home)
        server.process.send_signal(number)
        out, _ = server.process.communicate(timeout=10)
    assert "Traceback" not in out
    assert not temporary_folders(home)
    assert becomes(lambda: not any(os.path.exists(f"/proc/{pid}") for pid in workers))


def test_a_random_token_is_another_each_time(tmp_path: Path) -> None:
    tokens = []
    for k in range(2):
        with start(tmp_path / f"home{k}", "--port", 0) as process:
            assert process.stdout is not None
            tokens.append(process.stdout.readline().partition("token=")[2].strip())
            process.terminate()
    assert len(set(tokens)) == 2 and all(len(token) >= 20 for token in tokens)


def test_nothing_is_said_of_the_photos(tmp_path: Path, photo: Path) -> None:
    with served(tmp_path / "home") as server, server.client() as client:
        client.post("/api/rectify", files={"photo": ("secret.jpg", photo.read_bytes())})
        client.post("/api/rectify", files={"photo": ("secret.jpg", b"x")})
        client.get("/api/photos/secret/before")
        form = {"Content-Type": "multipart/form-data; boundary=x"}
        assert client.post("/api/rectify", content=b"--secret", headers=form).status_code == 400
        server.process.send_signal(signal.SIGTERM)
        out, _ = server.process.communicate(timeout=20)
    assert "secret" not in out and "POST" not in out
    assert all(line.startswith("unshutter: ") for line in out.splitlines() if line), out


def test_idle_it_takes_little(tmp_path: Path) -> None:
    began = time.monotonic()
    with served(tmp_path / "home") as server, server.client() as client:
        assert client.get("/api/about").status_code == 200
        assert time.monotonic() - began < 10  # measured: docs/guide/page; others may work beside it
        assert rss(server.process.pid) < 80 * MB


def test_the_server_itself_loads_no_arrays() -> None:
    """NumPy, OpenCV and PyAV are for its workers: they would only delay the page."""
    script = "import sys, unshutter.serve.app; print(*{'numpy', 'cv2', 'av', 'onnxruntime'} & set(sys.modules))"
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == ""
