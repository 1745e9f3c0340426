"""The server as a process: what it gives programs, what it bears, and how it ends."""

import asyncio
import io
import json
import os
import signal
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
import uvicorn
from starlette.types import Receive, Send

from support.batches import rectify
from support.frame_pairs import Scene
from support.page_server import Server, served, start, temporary_folders
from unshutter.cli import main
from unshutter.photo import Photo
from unshutter.serve import connections, openapi

MB = 1_000_000


def _rss(pid: int) -> int:
    """Resident memory [bytes] of a process and those that it started."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    own = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS"))
    return 1024 * int(own.split()[1]) + sum(_rss(int(child)) for child in children)


def _becomes(true: Callable[[], bool], within_s: float = 5) -> bool:
    deadline = time.monotonic() + within_s
    while not true() and time.monotonic() < deadline:
        time.sleep(0.02)
    return true()


def _part(photo: Path) -> dict[str, tuple[str, bytes]]:
    return {"photo": (photo.name, photo.read_bytes())}


def _opened(client: httpx.Client, photo: Path) -> str:
    answer = client.post("/api/photos", content=photo.read_bytes(), headers={"Unshutter-Name": photo.name})
    assert answer.status_code == 201
    return answer.json()["id"]


# ---- what it gives ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options", [{}, {"strength": "0.5", "edges": "crop"}, {"format": "png", "roll-deg": "1"}, {"strength": "0"}]
)
def test_a_picture_is_the_command_lines_to_the_byte(
    client: httpx.Client, photo: Path, tmp_path: Path, options: dict[str, str]
) -> None:
    flags = [word for name, value in options.items() if name != "format" for word in (f"--{name}", value)]
    expected = tmp_path / f"expected.{options.get('format', 'jpg')}"
    assert rectify(photo, "-o", expected, *flags) == 0
    direct = client.post("/api/rectify", files=_part(photo), data=options)
    assert direct.content == expected.read_bytes()
    assert json.loads(direct.headers["unshutter-result"])["changed"] == (options.get("strength") != "0")
    id = _opened(client, photo)
    client.get(f"/api/photos/{id}/after", params=options)  # whose motion is then used again
    shown = client.get(f"/api/photos/{id}/picture", params=options)
    assert shown.content == expected.read_bytes()
    assert json.loads(shown.headers["unshutter-name"]) == (
        "street.jpg.rectified.png" if "format" in options else "street.rectified.jpg"
    )


def test_a_motion_is_the_command_lines(client: httpx.Client, photo: Path, tmp_path: Path) -> None:
    assert main(["estimate", str(photo), "-o", str(tmp_path / "motion.json"), "--reference", "last"]) == 0
    answer = client.post("/api/estimate", files=_part(photo), data={"reference": "last"})
    assert answer.text == (tmp_path / "motion.json").read_text()


def test_a_motion_can_be_given(client: httpx.Client, photo: Path, facade_motion, tmp_path: Path) -> None:
    facade_motion.save(tmp_path / "motion.json")
    assert rectify(photo, "-o", tmp_path / "expected.jpg", "--motion", tmp_path / "motion.json") == 0
    given = _part(photo) | {"motion": ("m.json", (tmp_path / "motion.json").read_bytes())}
    assert client.post("/api/rectify", files=given).content == (tmp_path / "expected.jpg").read_bytes()
    damaged = client.post("/api/rectify", files=_part(photo) | {"motion": ("m.json", b"{}")})
    assert damaged.status_code == 422 and "the motion" in damaged.json()["error"]


def test_neighbours_are_parts_of_the_form(client: httpx.Client, tmp_path: Path) -> None:
    frames = [tmp_path / f"frame{number}.png" for number in range(2)]
    for number, frame in enumerate(frames):
        Photo.from_array(Scene().frame(number, 0.8)).save(frame)
    given = _part(frames[0]) | {"after": (frames[1].name, frames[1].read_bytes())}
    answer = client.post("/api/rectify", files=given, data={"readout-ratio": "0.8"})
    assert rectify(frames[0], "-o", tmp_path / "out.png", "--after", frames[1], "--readout-ratio", "0.8") == 0
    assert answer.content == (tmp_path / "out.png").read_bytes()
    Photo.from_array(Scene().frame(1, 0.8)[:100]).save(tmp_path / "smaller.png")
    given["after"] = ("smaller.png", (tmp_path / "smaller.png").read_bytes())
    refused = client.post("/api/rectify", files=given, data={"readout-ratio": "0.8"})
    assert refused.status_code == 422 and "its neighbour has 240x100 px" in refused.json()["error"]
    id = _opened(client, frames[0])
    assert client.get(f"/api/photos/{id}/after", params={"before": "x", "readout-ratio": "0.8"}).status_code == 404


def test_what_the_page_is_told(client: httpx.Client, photo: Path) -> None:
    id = _opened(client, photo)
    before = client.get(f"/api/photos/{id}/before", params={"longest": "320"})
    facts = json.loads(before.headers["unshutter-result"])
    assert (facts["width"], facts["height"]) == (560, 420)
    after = client.get(f"/api/photos/{id}/after", params={"longest": "320", "edges": "crop"})
    told = json.loads(after.headers["unshutter-result"])
    assert told["changed"] and told["edges"] == "crop" and len(told["tx_px"]) == len(told["rz_deg"])
    left, top, right, bottom = told["crop"]
    assert (right - left) * (bottom - top) == pytest.approx(told["whole"], abs=1e-6)
    lines = client.get(f"/api/photos/{id}/segments").json()
    assert len(lines["before"]) == len(lines["after"]) > 20
    assert all(-0.5 < share < 1.5 for line in lines["after"] for share in line)


def test_every_address_is_described(client: httpx.Client) -> None:
    from unshutter.serve.app import routes

    there = {
        (route.path, method) for route in routes() if route.path.startswith("/api/") for method in route.methods or ()
    }
    there = {(path, method.lower()) for path, method in there if method != "HEAD"} - {("/api/openapi.json", "get")}
    described = {(path, method) for path, methods in openapi.description()["paths"].items() for method in methods}
    assert described == there
    assert client.get("/api/openapi.json").json() == json.loads(json.dumps(openapi.description()))


# ---- saving many ---------------------------------------------------------------------------------------


def _events(client: httpx.Client, id: str) -> list[dict]:
    with client.stream("GET", f"/api/saves/{id}/events") as stream:
        return [json.loads(line[6:]) for line in stream.iter_lines() if line.startswith("data: ")]


def test_a_zip_file_of_all(client: httpx.Client, photo: Path, tmp_path: Path) -> None:
    ids = [_opened(client, photo) for _ in range(2)]
    photos = [{"id": ids[0]}, {"id": ids[1], "options": {"strength": "0.5"}}]
    saving = client.post("/api/saves", json={"to": "zip", "photos": photos}).json()
    told = _events(client, saving["id"])[-1]
    assert told["state"] == "finished" and [one["changed"] for one in told["done"]] == [True, True]
    packed = zipfile.ZipFile(io.BytesIO(client.get(f"/api/saves/{saving['id']}/file").content))
    assert packed.namelist() == ["street.rectified.jpg", "street.rectified-2.jpg"]
    assert rectify(photo, "-o", tmp_path / "half.jpg", "--strength", "0.5") == 0
    assert packed.read("street.rectified-2.jpg") == (tmp_path / "half.jpg").read_bytes()


def test_a_folder_is_never_written_over(tmp_path: Path, photo: Path) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "street.rectified.jpg").write_bytes(b"mine")
    with served(tmp_path / "home", "--folder", folder) as server, server.client() as client:
        name = {"Unshutter-Name": "../../broken.jpg"}
        broken = client.post("/api/photos", content=b"no photo", headers=name).json()["id"]
        photos = [{"id": _opened(client, photo)}, {"id": broken}]
        saving = client.post("/api/saves", json={"to": "folder", "photos": photos}).json()
        told = _events(client, saving["id"])[-1]["done"]
    assert told[0]["result"] == "street.rectified-2.jpg"
    assert "is not a JPEG" in told[1]["error"] and str(tmp_path) not in told[1]["error"]
    assert sorted(path.name for path in folder.iterdir()) == ["street.rectified-2.jpg", "street.rectified.jpg"]
    assert (folder / "street.rectified.jpg").read_bytes() == b"mine"


def test_saving_is_cancelled(client: httpx.Client, photo: Path) -> None:
    id = _opened(client, photo)
    hanging = {"id": id, "options": {"estimator": "hanging"}}
    saving = client.post("/api/saves", json={"to": "zip", "photos": [{"id": id}, hanging]}).json()
    with client.stream("GET", f"/api/saves/{saving['id']}/events") as stream:
        next(
            line for line in stream.iter_lines() if line.startswith("data: ") and len(json.loads(line[6:])["done"]) == 1
        )
    assert client.delete(f"/api/saves/{saving['id']}").json()["state"] == "cancelled"
    assert client.get(f"/api/saves/{saving['id']}/file").status_code == 404
    assert client.get(f"/api/photos/{id}/after").status_code == 200


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (b"nonsense", "send JSON"),
        (b'{"to": "mail", "photos": []}', "'to' takes file, zip"),
        (b'{"to": "zip", "photos": []}', "at least one"),
        (b'{"to": "folder", "photos": [{"id": "x"}]}', "start it with --folder"),
        (b'{"to": "zip", "photos": ["x"]}', "each photo is"),
        (b'{"to": "zip", "photos": [{"id": "x", "options": {"strength": 1}}]}', "each photo is"),
    ],
)
def test_savings_that_are_refused(client: httpx.Client, body: bytes, told: str) -> None:
    answer = client.post("/api/saves", content=body)
    assert answer.status_code == 400 and told in answer.json()["error"]


# ---- what it bears ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["../../evil.jpg", "/tmp/evil.jpg", "..%2f..%2fevil.jpg", "a\\..\\evil.jpg"])
def test_names_lead_nowhere(client: httpx.Client, photo: Path, name: str) -> None:
    answer = client.post("/api/rectify", files={"photo": (name, photo.read_bytes())})
    assert answer.status_code == 200
    assert "/" not in json.loads(answer.headers["unshutter-name"])
    bad = client.post("/api/rectify", files={"photo": (name, b"no photo")})
    assert bad.status_code == 422
    assert "unshutter-serve-" not in bad.json()["error"] and "\n" not in bad.json()["error"]


@pytest.mark.parametrize("id", ["../x", "%2e%2e", "x" * 5000, "0"])
def test_ids_lead_nowhere(client: httpx.Client, id: str) -> None:
    assert client.get(f"/api/photos/{id}/before").status_code == 404


def test_forms_that_are_refused(client: httpx.Client, photo: Path) -> None:
    asked = {
        "multipart": client.post("/api/rectify", content=b"x"),
        "the photo is missing": client.post("/api/rectify", files={"other": b"x"}),
        "unknown field": client.post("/api/rectify", files=_part(photo), data={"colour": "red"}),
        "is empty": client.post("/api/rectify", files={"photo": ("a.jpg", b"")}),
    }
    for told, answer in asked.items():
        assert answer.status_code in (400, 422) and told in answer.json()["error"], answer.text
    boundary = {"Content-Type": "multipart/form-data; boundary=x"}
    damaged = client.post("/api/rectify", content=b"--x\r\nnonsense", headers=boundary)
    assert damaged.status_code in (400, 422)


def test_bombs_are_refused_as_on_the_command_line(client: httpx.Client) -> None:
    head = b"IHDR" + struct.pack(">IIBBBBB", 40_000, 40_000, 8, 2, 0, 0, 0)
    chunks = (head, b"IDAT" + zlib.compress(bytes(1000)), b"IEND")
    bomb = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) for chunk in chunks
    )
    answer = client.post("/api/rectify", files={"photo": ("bomb.png", bomb)})
    assert answer.status_code == 422
    assert "1600 megapixels), more than the limit of 1000 megapixels" in answer.json()["error"]


def test_a_crash_is_survived(client: httpx.Client, photo: Path) -> None:
    id = _opened(client, photo)
    crashed = client.get(f"/api/photos/{id}/after", params={"estimator": "crashing"})
    assert crashed.status_code == 422
    assert crashed.json()["error"] == "its worker died: not enough memory, or a fault in a decoder"
    assert client.get(f"/api/photos/{id}/after").status_code == 200
    assert client.post("/api/rectify", files=_part(photo)).status_code == 200


def test_two_hundred_requests_at_once(tmp_path: Path, photo: Path) -> None:
    """Some are done, the others told to come again; memory stays bounded, and then all is as before."""
    data = photo.read_bytes() + bytes(2 * MB)  # what follows a JPEG's end is nobody's
    with served(tmp_path / "home") as server, server.client() as client:
        assert client.post("/api/wake").status_code == 204
        before, fast = _rss(server.process.pid), {"estimator": "none"}

        def ask(_: int) -> int:
            try:
                with server.client() as own:
                    return own.post("/api/rectify", files={"photo": ("a.jpg", data)}, data=fast).status_code
            except httpx.HTTPError:  # refused before all of it was sent
                return 503

        with ThreadPoolExecutor(200) as threads:
            answers = [threads.submit(ask, k) for k in range(200)]
            most = before
            while not all(answer.done() for answer in answers):
                most = max(most, _rss(server.process.pid))
                time.sleep(0.05)
        codes = [answer.result() for answer in answers]
        assert set(codes) <= {200, 503}
        assert codes.count(200) >= 20 and codes.count(503) >= 20
        assert most - before < 400 * MB
        assert client.post("/api/rectify", files=_part(photo)).status_code == 200
        assert _becomes(lambda: not any(path.is_dir() for path in temporary_folders(tmp_path / "home")[0].iterdir()))


def test_connections_without_a_request_are_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "_PATIENCE_S", 0.3)

    async def answer(scope: dict, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def ask() -> tuple[bytes, bytes, bytes]:
        config = uvicorn.Config(answer, http=connections.Connection, lifespan="off", log_config=None, port=0)
        server = uvicorn.Server(config)
        serving = asyncio.create_task(server._serve())
        while not server.started:
            await asyncio.sleep(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        silent, halting, asking = [await asyncio.open_connection("127.0.0.1", port) for _ in range(3)]
        halting[1].write(b"GET / HTTP/1.1\r\nHost: 127")
        asking[1].write(b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
        got = await asyncio.gather(*(asyncio.wait_for(each[0].read(12), 3) for each in (silent, halting, asking)))
        server.should_exit = True
        for each in (silent, halting, asking):
            each[1].close()
        await serving
        return tuple(got)

    assert asyncio.run(ask()) == (b"", b"", b"HTTP/1.1 204")


# ---- how it starts and ends --------------------------------------------------------------------------------


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
        _opened(client, photo)
        assert client.post("/api/rectify", files=_part(photo)).status_code == 200
        workers = Path(f"/proc/{server.process.pid}/task/{server.process.pid}/children").read_text().split()
        assert temporary_folders(home)
        server.process.send_signal(number)
        out, _ = server.process.communicate(timeout=10)
    assert "Traceback" not in out
    assert not temporary_folders(home)
    assert _becomes(lambda: not any(os.path.exists(f"/proc/{pid}") for pid in workers))


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
        server.process.send_signal(signal.SIGTERM)
        out, _ = server.process.communicate(timeout=20)
    assert "secret" not in out and "POST" not in out


def test_idle_it_takes_little(tmp_path: Path) -> None:
    began = time.monotonic()
    with served(tmp_path / "home") as server, server.client() as client:
        assert client.get("/api/about").status_code == 200
        assert time.monotonic() - began < 10  # measured: docs/page; others may work beside it
        assert _rss(server.process.pid) < 80 * MB
