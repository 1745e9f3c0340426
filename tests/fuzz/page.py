"""Mutated requests to the page: an answer of one line for each, no trace of a fault, and a server as fast as before.

python tests/fuzz/page.py [--requests 5000] [--seed 0] [json] [queries]
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

import httpx

sys.path.insert(0, str(Path(__file__).parent.parent))

from support import clips
from support.drawn_photos import encoded, textured
from support.odd_requests import TEXTS, Odd
from support.page_server import Server, events, rss, served, temporary_folders
from unshutter.errors import visible
from unshutter.options.clip_options import RectifyClip
from unshutter.page.settings import PhotoOptions, fields

MOST_FAILURES, LONGEST_S, MORE_MEMORY, SHOWN = 20, 60.0, 400_000_000, 800
METHODS = ["none", "none", "segment-manhattan"]  # of which one takes no time
PHOTO_FIELDS, CLIP_FIELDS = list(fields(PhotoOptions)), list(fields(RectifyClip))
_USUAL = ("unshutter: open this link", "unshutter: stopped")  # lines of the server's log
NAMES = {"photos": "a.jpg", "clips": "walk.mp4"}
QUERIES = {
    "photos": ("before", "after", "segments", "picture", "motion"),
    "clips": ("before", "after", "readout"),
}


class Fuzz:
    """Asks a server odd things.

    Args:
        server: that runs.
        client: by which it is asked.
        seed: of what is drawn at random.
        photo, video: small files.
    """

    def __init__(self, server: Server, client: httpx.Client, seed: int, photo: bytes, video: bytes):
        self.server, self.client, self.photo, self.film = server, client, photo, video
        self.ids = {kind: self._opened(kind, data) for kind, data in (("photos", photo), ("clips", video))}
        self.odd = Odd(seed, list(self.ids.values()), METHODS)
        self.counts: Counter[str] = Counter()
        self.failures: list[str] = []
        self.slowest_s = 0.0

    def _opened(self, kind: str, data: bytes) -> str:
        return self.client.post(f"/api/{kind}", content=data, headers={"Unshutter-Name": NAMES[kind]}).json()["id"]

    # ---- what is asked ---------------------------------------------------------------------------------------

    def json(self) -> None:
        """``/api/saves``: photos and clips with their options."""
        kind = self.odd.one(("photos", "photos", "photos", "clips"))
        some = PHOTO_FIELDS if kind == "photos" else CLIP_FIELDS
        items = [{"id": self.ids[kind], "options": self.odd.options(some)} for _ in range(self.odd.one((1, 1, 2)))]
        whole = {"to": self.odd.one(("file", "zip", "zip")), "photos": items}
        self._ask("POST", "/api/saves", content=self.odd.json(whole))

    def queries(self) -> None:
        """What the page asks of open files, and names of files that come in."""
        if self.odd.chance(0.1):
            return self._name()
        kind = self.odd.one(("photos", "photos", "clips"))
        params = self.odd.options(PHOTO_FIELDS if kind == "photos" else CLIP_FIELDS)
        for name, usual in (("longest", "320"), ("moment", "1"), ("later", "1")):
            if self.odd.chance(0.2):
                params[name] = self.odd.one(TEXTS) if self.odd.chance(0.3) else usual
        id = quote(self.odd.one(TEXTS[:60]), safe="", errors="replace") if self.odd.chance(0.05) else self.ids[kind]
        params = {name.encode("utf-8", "replace"): text.encode("utf-8", "replace") for name, text in params.items()}
        self._ask("GET", f"/api/{kind}/{id}/{self.odd.one(QUERIES[kind])}", params=params)

    def _name(self) -> None:
        """A file that comes in under an odd name, is looked at, and closed."""
        name = quote(self.odd.one(TEXTS) + self.odd.one(("", ".jpg", "%05d.png", ".mp4", ".m3u8")), errors="replace")
        kind, data = self.odd.one((("photos", self.photo), ("clips", self.film)))
        answer = self._ask("POST", f"/api/{kind}", content=data, headers={"Unshutter-Name": name[:6000]})
        if answer is not None and answer.status_code == 201:
            id = answer.json()["id"]
            item = {"id": id, "options": {"estimator": "none"} if kind == "photos" else {"readout-ratio": "0.5"}}
            self._ask("POST", "/api/saves", json={"to": "zip", "photos": [item]})
            self._ask("DELETE", f"/api/{kind}/{id}")

    # ---- what is answered ------------------------------------------------------------------------------------

    def _ask(self, method: str, path: str, **more) -> httpx.Response | None:
        start = time.monotonic()
        try:
            answer = self.client.request(method, path, **more)
        except httpx.HTTPError as error:
            return self._fail(f"no answer ({error!r})", method, path, more)
        took_s = time.monotonic() - start
        self.slowest_s = max(self.slowest_s, took_s)
        self.counts[f"{path.split('/')[2]} {answer.status_code}"] += 1
        if took_s > LONGEST_S:
            self._fail(f"answered after {took_s:.0f} s", method, path, more)
        if not answer.is_success:
            told = _refusal(answer)
            if answer.status_code // 100 != 4 or not self._is_a_line(told):
                self._fail(f"{answer.status_code}: {told!r:.300}", method, path, more)
        elif answer.status_code == 202 and (wrong := self._followed(answer.json()["id"])):
            self._fail(wrong, method, path, more)
        return answer

    def _followed(self, id: str) -> str | None:
        """What is wrong with a saving, which is watched to its end and forgotten."""
        last = list(events(self.client, id))[-1]
        self.counts[f"a saving {last['state']}"] += 1
        told = [last["error"]] if "error" in last else [one["error"] for one in last["done"] if "error" in one]
        whole = last["state"] == "finished" and len(last["done"]) == last["total"]
        file = self.client.get(f"/api/saves/{id}/file").status_code
        forgotten = self.client.delete(f"/api/saves/{id}").status_code
        if not whole or file not in (200, 404) or forgotten != 200 or not all(map(self._is_a_line, told)):
            return f"a saving ended as {last!r:.600}, its file {file}, forgotten {forgotten}"
        return None

    def _is_a_line(self, told: object) -> bool:
        return (
            isinstance(told, str)
            and 0 < len(told) < 20_000
            and told == visible(told)
            and not any(each in told for each in ("Traceback", "unexpected", "unshutter-serve-", "please report"))
        )

    def _fail(self, what: str, method: str, path: str, more: dict) -> None:
        asked = str(more)
        asked = asked if len(asked) < 2 * SHOWN else f"{asked[:SHOWN]} ... {asked[-SHOWN:]}"
        self.failures.append(f"{method} {path}: {what}\n    {asked}")
        print(self.failures[-1], flush=True)


def _refusal(answer: httpx.Response) -> object:
    try:
        return answer.json()["error"]
    except (ValueError, KeyError, TypeError):
        return answer.content


def run(family: str, requests: int, seed: int) -> int:
    """Asks so much of one kind; returns how many answers were wrong."""
    photo, motion = encoded(textured(120, 160), "JPEG"), clips.moving(12)[1]
    with TemporaryDirectory() as name:
        video = clips.write(Path(name) / "walk.mp4", motion, options={"preset": "ultrafast"}).read_bytes()
        home = Path(name) / "home"
        with served(home) as server, server.client() as client:
            fuzz = Fuzz(server, client, seed, photo, video)
            ask: Callable[[], None] = getattr(fuzz, family)
            ask()
            memory, before, start = rss(server.process.pid), _lying(home), time.monotonic()
            for number in range(requests):
                ask()
                if number % 500 == 499:
                    print(f"{family}: {number + 1} in {time.monotonic() - start:.0f} s", file=sys.stderr)
                if len(fuzz.failures) >= MOST_FAILURES:
                    break
            took_s = time.monotonic() - start
            _check_after(fuzz, home, memory, before)
            server.process.terminate()
            log, _ = server.process.communicate(timeout=20)
    said = [line for line in log.splitlines() if line and not line.startswith(_USUAL)]
    if said:
        fuzz.failures.append("the server said: " + "\n".join(said)[:3000])
        print(fuzz.failures[-1])
    wrong = len(fuzz.failures)
    print(f"{family}: {requests} requests in {took_s:.0f} s, slowest {fuzz.slowest_s:.1f} s, {wrong} wrong")
    print("   ", ", ".join(f"{what}: {count}" for what, count in sorted(fuzz.counts.items())), flush=True)
    return wrong


def _lying(home: Path) -> int:
    return sum(1 for _ in temporary_folders(home)[0].iterdir())


def _check_after(fuzz: Fuzz, home: Path, memory: int, before: int) -> None:
    """The server is there, quick, as small as before, and has kept no file."""
    start = time.monotonic()
    about = fuzz.client.get("/api/about")
    took_s = time.monotonic() - start
    again = fuzz.client.get(f"/api/photos/{fuzz.ids['photos']}/picture", params={"estimator": "none"})
    more = rss(fuzz.server.process.pid) - memory
    wrong = {
        "it does not answer": about.status_code != 200 or again.status_code != 200,
        f"it took {took_s:.1f} s to answer": took_s > 1,
        f"it has {more / 1e6:.0f} MB more": more > MORE_MEMORY,
        f"{_lying(home) - before} files lie there still": _lying(home) > before + 1,
    }
    fuzz.failures += [f"afterwards: {what}" for what, is_so in wrong.items() if is_so]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("families", nargs="*", default=["json", "queries"])
    parser.add_argument("--requests", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    return min(sum([run(family, given.requests, given.seed) for family in given.families]), 1)


if __name__ == "__main__":
    sys.exit(main())
