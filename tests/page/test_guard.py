"""Who may use the page."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.page_server import TOKEN, Asking, desk
from unshutter.page import app
from unshutter.page.app import application
from unshutter.page.settings import Settings

KNOWN = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture
def client() -> Iterator[Asking]:
    with desk() as one:
        yield Asking(application(one, TOKEN, 8720), "http://127.0.0.1:8720")


@pytest.mark.parametrize("host", ["127.0.0.1:8720", "localhost:8720", "LOCALHOST:8720", "[::1]:8720"])
def test_own_names(client: Asking, host: str) -> None:
    assert client.get("/api/about", headers=KNOWN | {"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example:8720",
        "evil.example",
        "127.0.0.1",
        "127.0.0.1:80",
        "127.0.0.1.evil.example:8720",
        "192.168.1.5:8720",
        "",
    ],
)
@pytest.mark.parametrize("path", ["/", "/page/main.js", "/api/about"])
def test_another_name_that_leads_here_is_refused(client: Asking, host: str, path: str) -> None:
    answer = client.get(path, headers=KNOWN | {"Host": host})
    assert answer.status_code == 403
    assert "not the name of this server" in answer.json()["error"]


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://127.0.0.1:9999", "http://localhost:8720"])
@pytest.mark.parametrize("method", ["GET", "POST", "OPTIONS"])
def test_pages_of_others_are_refused(client: Asking, origin: str, method: str) -> None:
    answer = client.request(method, "/api/wake", headers=KNOWN | {"Origin": origin})
    assert answer.status_code == 403
    assert "access-control-allow-origin" not in answer.headers


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_requests_that_browsers_call_anothers_are_refused(client: Asking, site: str) -> None:
    assert client.get("/api/about", headers=KNOWN | {"Sec-Fetch-Site": site}).status_code == 403


def test_the_own_page_may_ask(client: Asking) -> None:
    own = {"Origin": "http://127.0.0.1:8720", "Sec-Fetch-Site": "same-origin"}
    assert client.get("/api/about", headers=KNOWN | own).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [{}, {"Authorization": "Bearer "}, {"Authorization": "Bearer wrong"}, {"Authorization": f"Basic {TOKEN}"}],
)
def test_the_api_wants_the_token(client: Asking, headers: dict[str, str]) -> None:
    for path in ("/api/about", "/api/photos/x/before", "/api/nothing"):
        assert client.get(path, headers=headers).status_code == 401
    assert client.post("/api/photos", headers=headers).status_code == 401


def test_the_token_does_not_count_in_the_query(client: Asking) -> None:
    assert client.get(f"/api/about?token={TOKEN}").status_code == 401


def test_the_page_itself_says_nothing_that_needs_a_token(client: Asking) -> None:
    for path in ("/", "/page/main.js", "/page/style.css"):
        answer = client.get(path)
        assert answer.status_code == 200
        assert TOKEN not in answer.text


@pytest.mark.parametrize("path", ["/", "/api/about", "/page/none"])
def test_every_answer_keeps_browsers_careful(client: Asking, path: str) -> None:
    headers = client.get(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "unsafe" not in policy and "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize(
    "path", ["/page/../settings.py", "/page/%2e%2e/settings.py", "/page/..%2fsettings.py", "/page//etc/passwd"]
)
def test_only_the_pages_files_are_handed_out(client: Asking, path: str) -> None:
    answer = client.get(path)
    assert answer.status_code == 404
    assert "max_mb" not in answer.text


def test_an_update_of_its_files_does_not_end_the_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    files = shutil.copytree(app.PAGE, tmp_path / "page")
    monkeypatch.setattr(app, "PAGE", files)
    with desk() as one:
        client = Asking(application(one, TOKEN, 8720), "http://127.0.0.1:8720")
        read = {f"/page/{file.name}": file.read_bytes() for file in files.iterdir() if file.suffix != ".ts"}
        shutil.rmtree(files)
        for path, content in (read | {"/": read["/page/index.html"]}).items():
            assert client.get(path).content == content
        assert client.get("/page/main.js").headers["content-type"].startswith("text/javascript")


def test_a_host_of_the_users_own_is_known() -> None:
    with desk(Settings(token=TOKEN, host="0.0.0.0", i_know=True)) as one:
        client = Asking(application(one, TOKEN, 8720), "http://192.168.1.5:8720")
        assert client.get("/api/about", headers=KNOWN).status_code == 200
        assert client.get("/api/about", headers=KNOWN | {"Host": "evil.example:8720"}).status_code == 403
