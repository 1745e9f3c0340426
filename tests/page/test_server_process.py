"""The server as a process: how it starts, and what is left when it ends."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from support.covering import thorough
from support.page_server import LONG_S, Server, becomes, rss, sent, served, start, temporary_folders

MB = 1_000_000


def _refusal(home: Path, *arguments: object) -> tuple[int, str]:
    process = start(home, *arguments)
    out, _ = process.communicate(timeout=LONG_S)
    return process.returncode, out


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["--host", "0.0.0.0"], 2, "add --i-know"),
        (["--token", "short"], 2, "--token needs at least 8 characters"),
        (["--port", "99999"], 2, "--port must lie between"),
        (["--max-mb", "0"], 2, "--max-mb must lie between"),
        (["--host", "no.such.host.invalid", "--i-know"], 1, "cannot listen on"),
    ],
)
def test_starts_that_are_refused(tmp_path: Path, arguments: list[str], code: int, told: str) -> None:
    returned, out = _refusal(tmp_path / "home", *arguments)
    assert returned == code and told in out and out.count("\n") == 1, out


def test_a_port_that_is_taken(server: Server, tmp_path: Path) -> None:
    code, out = _refusal(tmp_path / "home", "--port", server.port)
    assert code == 1 and "Address already in use; --port 0" in out and out.count("\n") == 1


@pytest.mark.parametrize("number", [thorough(signal.SIGINT), signal.SIGTERM, thorough(signal.SIGHUP)])
def test_nothing_is_left_and_nothing_is_said_of_the_photos(tmp_path: Path, photo: Path, number: int) -> None:
    home = tmp_path / "home"
    with served(home) as server, server.client() as client:
        for content, status in ((photo.read_bytes(), 200), (b"x", 422)):
            id = sent(client, "secret.jpg", content)
            assert client.get(f"/api/photos/{id}/picture").status_code == status
        client.get("/api/photos/secret/before")
        assert client.post("/api/saves", content=b"--secret").status_code == 400
        workers = Path(f"/proc/{server.process.pid}/task/{server.process.pid}/children").read_text().split()
        assert temporary_folders(home)
        server.process.send_signal(number)
        out, _ = server.process.communicate(timeout=LONG_S)
    assert "Traceback" not in out and "secret" not in out and "POST" not in out
    assert all(line.startswith("unshutter: ") for line in out.splitlines() if line), out
    assert not temporary_folders(home)
    assert becomes(lambda: not any(os.path.exists(f"/proc/{pid}") for pid in workers))


def test_the_token_is_on_no_command_line(tmp_path: Path) -> None:
    """The browser gets a file that leads to the page, and that nobody else can read; each start has another token."""
    browser = tmp_path / "browser"
    browser.write_text('#!/bin/sh\ncd "${0%/*}"; printf %s "$1" > part && mv part got\n')
    browser.chmod(0o755)
    with start(tmp_path / "home", "--port", 0, "--open", BROWSER=f"{browser} %s") as process:
        assert process.stdout is not None
        link = process.stdout.readline().split()[1]
        there = becomes((tmp_path / "got").exists)
        opened = (tmp_path / "got").read_text() if there else ""
        file = Path(opened.removeprefix("file://"))
        content, modes = "", []
        if file.is_file():
            content, modes = file.read_text(), [each.stat().st_mode & 0o777 for each in (file, file.parent)]
        process.terminate()
    token = link.partition("token=")[2]
    assert len(token) >= 20 and token not in opened and link in content and modes == [0o600, 0o700]
    assert not file.exists()
    with start(tmp_path / "again", "--port", 0) as process:
        assert process.stdout is not None
        assert token not in process.stdout.readline()
        process.terminate()


def test_idle_it_takes_little_and_silent_connections_keep_nobody_out(tmp_path: Path) -> None:
    with served(tmp_path / "home") as server, server.client() as client, ExitStack() as stack:
        assert client.get("/api/about").status_code == 200
        times = Path(f"/proc/{server.process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
        assert sum(map(int, times)) / os.sysconf("SC_CLK_TCK") < 5  # processor time [s]; measured: docs/guide/page
        assert rss(server.process.pid) < 80 * MB
        for _ in range(300):
            silent = stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            silent.sendall(b"GET / HTTP/1.1\r\n")
        with server.client() as another:
            assert another.get("/api/about").status_code == 200


def test_the_server_itself_loads_no_arrays() -> None:
    """NumPy, OpenCV and PyAV are for its workers: they would only delay the page."""
    script = "import sys, unshutter.page.app; print(*{'numpy', 'cv2', 'av', 'onnxruntime'} & set(sys.modules))"
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == ""
