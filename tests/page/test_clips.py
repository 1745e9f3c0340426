"""Clips over the API: looked at, made as on the command line, refused in one line."""

import asyncio
import io
import json
import time
from pathlib import Path
from types import ModuleType

import av
import httpx
import numpy as np
import pytest

from support import clips
from support.covering import thorough
from support.hand_held import hand, pan
from support.page_server import (
    TOKEN,
    Asking,
    becomes,
    desk,
    events,
    facts,
    opened,
    saving,
    sent,
    served,
    temporary_folders,
    zipped,
)
from unshutter import version
from unshutter.cli import main
from unshutter.cli.arguments import parse
from unshutter.cli.clip_command import VIDEO
from unshutter.errors import UsageError
from unshutter.options.clip_options import RectifyClip
from unshutter.page import app, clip_jobs, saves
from unshutter.page.app import application
from unshutter.page.opened import OpenFile, ProgressFile
from unshutter.page.settings import Settings, fields, read_clip
from unshutter.reasons import Code
from unshutter.video.calibrate import gain, questions

KNOWN = {"Authorization": f"Bearer {TOKEN}"}
RATIO = {"readout-ratio": "0.6", "focal-px": str(clips.FOCAL)}
GREYS = clips.moving(20)[1]


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clips.write(tmp_path_factory.mktemp("clips") / "walk.mp4", GREYS, sound=True)


@pytest.fixture(scope="module")
def lossless(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One whose result can be compared: x264 does not write the same bytes every time."""
    return clips.write(tmp_path_factory.mktemp("clips") / "walk.mkv", GREYS, "ffv1", sound=True)


@pytest.fixture(scope="module")
def long_walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One that takes a while."""
    path = tmp_path_factory.mktemp("clips") / "long.mp4"
    return clips.write(path, GREYS * 40, options={"preset": "ultrafast"})


def _told_of(client: httpx.Client, id: str, options: dict[str, str] = RATIO) -> dict:
    """Saves a clip as a file; returns what is told of it, and the task's id."""
    task = saving(client, [{"id": id, "options": options}], "file")
    told = list(events(client, task))[-1]
    assert told["state"] == "finished"
    return told["done"][0] | {"task": task}


def _wait_for_frames(client: httpx.Client, task: str) -> None:
    for told in events(client, task):
        assert told["state"] == "working"
        if told["now"] and told["now"].get("done"):
            return
    raise AssertionError("no frame was told of")


def _fetched(client: httpx.Client, task: str, to: Path) -> Path:
    answer = client.get(f"/api/saves/{task}/file")
    assert answer.status_code == 200
    to.write_bytes(answer.content)
    return to


def _are_alike(one: Path, other: Path) -> None:
    """Every frame and every packet beside them."""
    assert np.array_equal(clips.luma(one), clips.luma(other))
    assert clips.times(one) == clips.times(other)
    assert clips.packets(one) == clips.packets(other)
    assert clips.facts(one) == clips.facts(other)


def _refused(answer: httpx.Response, status: int, told: str) -> None:
    assert answer.status_code == status, answer.text
    line = answer.json()["error"]
    assert told in line and "\n" not in line and "unshutter-serve-" not in line, line


# ---- what it gives ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        thorough(RATIO),
        {"readout-ms": "15", "focal-px": str(clips.FOCAL), "strength": "0.5", "edges": "crop"},
        thorough(RATIO | {"reference": "last"}),
    ],
)
def test_a_clip_is_the_command_lines(
    client: httpx.Client, lossless: Path, tmp_path: Path, options: dict[str, str]
) -> None:
    flags = [word for name, value in options.items() for word in (f"--{name}", value)]
    assert main(["video", str(lossless), "-o", str(tmp_path / "expected.mkv"), *flags]) == 0
    told = _told_of(client, opened(client, lossless, "clips"), options)
    assert told["frames"] == 20
    answer = client.get(f"/api/saves/{told['task']}/file")
    assert json.loads(answer.headers["unshutter-name"]) == "walk.rectified.mkv"
    _are_alike(_fetched(client, told["task"], tmp_path / "saved.mkv"), tmp_path / "expected.mkv")
    client.delete(f"/api/saves/{told['task']}")
    assert client.get(f"/api/saves/{told['task']}/file").status_code == 404


def test_a_clip_that_was_read_another_way(client: httpx.Client, tmp_path: Path) -> None:
    """Its frames show it, so that the page undoes its motion that way."""
    greys = [np.ascontiguousarray(np.rot90(grey, 3)) for grey in clips.moving(40, hand(4, seconds=6.0), ratio=0.6)[1]]
    video = clips.write(tmp_path / "turned.mkv", greys, "ffv1")
    id, known = opened(client, video, "clips"), {"focal-px": str(clips.FOCAL)}
    assert client.get(f"/api/clips/{id}/readout", params=known).json()["direction"] == "right-to-left"
    assert facts(client.get(f"/api/clips/{id}/after", params=known | {"moment": "2"}))["changed"]
    assert _told_of(client, id, known)["rectified"] == 40


def test_what_was_judged_for_the_preview_is_not_judged_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only options that the plan depends on ask for another; the bytes are the command line's in any case."""
    video = clips.write(tmp_path / "walk.mkv", clips.moving(28)[1], "ffv1")
    stored = OpenFile("x", "clip", "walk.mkv", video, 1_000_000)
    asked: list[str] = []

    def counted(module: ModuleType, name: str) -> None:
        real = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *given, **more: asked.append(name) or real(*given, **more))

    counted(questions, "sample_frames")
    counted(gain, "motions_of_parts")
    usual = {"focal-px": str(clips.FOCAL)}  # half of a search is to find it
    clip_jobs.measure_readout_time(stored, read_clip(usual))
    clip_jobs.after(stored, read_clip(usual), 2, 320)
    judged = ["sample_frames", "motions_of_parts"]
    result, expected = tmp_path / "saved.mkv", tmp_path / "expected.mkv"
    for flags, again in (
        ({"edges": "keep", "zoom-limit": "5", "stabilize": "2"}, []),
        ({"end": "0.8"}, judged),
        ({"strength": "0.5"}, ["motions_of_parts"]),
        ({"strength": "0.5"}, []),
    ):
        asked.clear()
        result.unlink(missing_ok=True)
        clip_jobs.rectified(stored, result, read_clip(usual | flags), ProgressFile(tmp_path / "progress.json"))
        assert asked == again
    words = ["video", str(video), "-o", str(expected), "--strength", "0.5", "--focal-px", str(clips.FOCAL)]
    assert main(words) == 0
    assert result.read_bytes() == expected.read_bytes()


def test_a_clip_that_is_closed_while_it_is_saved(client: httpx.Client, long_walk: Path, tmp_path: Path) -> None:
    id = opened(client, long_walk, "clips")
    task = saving(client, [{"id": id, "options": RATIO | {"end": "3"}}], "file")
    _wait_for_frames(client, task)
    assert client.delete(f"/api/clips/{id}").status_code == 204
    assert client.get(f"/api/clips/{id}/before").status_code == 404
    told = list(events(client, task))[-1]
    assert told["done"][0].get("frames") == 90, told
    assert len(clips.luma(_fetched(client, task, tmp_path / "saved.mp4"))) == 90


def test_moments(client: httpx.Client, walk: Path) -> None:
    id = opened(client, walk, "clips")
    before = client.get(f"/api/clips/{id}/before", params={"longest": "320", "moment": "2"})
    told = facts(before)
    assert (told["width"], told["height"]) == (192, 144)
    assert told["moments_s"] == pytest.approx([(k + 0.5) / 5 * 20 / 30 for k in range(5)])
    part = facts(client.get(f"/api/clips/{id}/before", params={"start": "0.2", "end": "0.4"}))
    assert part["moments_s"] == pytest.approx([0.22, 0.26, 0.3, 0.34, 0.38], abs=1e-6)
    after = client.get(f"/api/clips/{id}/after", params=RATIO | {"longest": "320", "moment": "2"})
    assert facts(after)["changed"] and after.content != before.content
    half = facts(client.get(f"/api/clips/{id}/after", params=RATIO | {"moment": "2", "strength": "0.5"}))
    assert half["largest_px"] == pytest.approx(facts(after)["largest_px"] / 2, rel=0.05)


def test_a_clip_held_upright_is_seen_upright(client: httpx.Client, tmp_path: Path) -> None:
    id = opened(client, clips.write(tmp_path / "turned.mp4", GREYS[:3], turn=90), "clips")
    told = facts(client.get(f"/api/clips/{id}/before"))
    assert (told["width"], told["height"]) == (144, 192)


def test_a_search_that_nobody_waits_for_is_stopped(client: httpx.Client, long_walk: Path) -> None:
    id = opened(client, long_walk, "clips")
    assert client.get(f"/api/clips/{id}/progress").json() == {}
    with pytest.raises(httpx.ReadTimeout):
        client.get(f"/api/clips/{id}/readout", timeout=1)
    noted: list[dict] = []

    def stands_still() -> bool:
        noted[:] = [client.get(f"/api/clips/{id}/progress").json() for _ in range(2) if not time.sleep(1)]
        return noted[0] == noted[1]

    assert becomes(stands_still) and noted[0].get("done", 0) < noted[0].get("total", 1)


def test_the_video_shows_stabilisation(client: httpx.Client, walk: Path) -> None:
    id = opened(client, walk, "clips")
    last = {}
    for seconds in ("", "2"):
        video = client.get(f"/api/clips/{id}/film", params={**RATIO, "stabilize": seconds, "moment": 2})
        frames = list(av.open(io.BytesIO(video.content), "r").decode(video=0))
        assert len(frames) == len(GREYS)
        last[seconds] = frames[-1].to_ndarray(format="gray").astype(float)
    before, after = (slice(None), slice(clips.WIDTH)), (slice(None), slice(clips.WIDTH, None))
    assert np.abs(last[""][before] - last["2"][before]).mean() < 2  # the clip itself
    assert np.abs(last[""][after] - last["2"][after]).mean() > 5  # turned and enlarged


def test_the_readout_time(client: httpx.Client, walk: Path, tmp_path: Path) -> None:
    told = client.get(f"/api/clips/{opened(client, walk, 'clips')}/readout", params={"readout-ms": "20"}).json()
    assert told["ratio"] == pytest.approx(0.6) and told["found_by"] == "given"
    id = opened(client, clips.write(tmp_path / "still.mp4", clips.standing(30)), "clips")
    for _ in range(2):  # found out once, and remembered
        usual = client.get(f"/api/clips/{id}/readout").json()
        assert usual["found_by"] == "usual value" and "the camera stood still" in usual["reason"]
        low, high = usual["plausible_ms"]
        assert low < usual["ms"] < high and usual["cameras"] == "cameras and phones"
        after = facts(client.get(f"/api/clips/{id}/after"))
        assert not after["changed"] and after["code"] == Code.NOTHING_TO_SEE  # as the command line says


def test_a_clip_that_is_left_is_shown_as_it_is(client: httpx.Client, tmp_path: Path) -> None:
    """An even pan shows no readout time: nothing of it is undone until its time is given."""
    greys = clips.moving(30, pan(3 * np.degrees(1 / clips.FOCAL) * clips.FPS), ratio=0.5)[1]
    id = opened(client, clips.write(tmp_path / "pan.mkv", greys, "ffv1"), "clips")  # the same frames each time
    assert client.get(f"/api/clips/{id}/readout").json()["left"]
    after = client.get(f"/api/clips/{id}/after", params={"moment": "2"})
    told = facts(after)
    assert not told["changed"] and told["largest_px"] == 0 and told["code"] == Code.READOUT_TIME_UNKNOWN
    assert after.content == client.get(f"/api/clips/{id}/before", params={"moment": "2"}).content
    assert client.get(f"/api/clips/{id}/film", params={"moment": "2"}).status_code == 200


def test_photos_and_clips_in_one_zip_file(client: httpx.Client, tmp_path: Path, photo: Path, walk: Path) -> None:
    """A clip that does not change is encoded only where that is asked for."""
    still = clips.write(tmp_path / "still.mkv", clips.standing(8), "ffv1")
    ids = [opened(client, each, "clips") for each in (walk, walk, still, still)]
    options = [RATIO, RATIO, RATIO, RATIO | {"codec": "libx264"}]
    items = [{"id": id, "options": each} for id, each in zip(ids, options, strict=True)]
    done, packed = zipped(client, [{"id": opened(client, photo)}, *items])
    walks = ["walk.rectified.mp4", "walk.rectified-2.mp4"]
    assert packed.namelist() == ["street.rectified.jpg", *walks, "still.mkv", "still.rectified.mkv"]
    assert [one["result"] for one in done] == packed.namelist()
    assert len(clips.luma(Path(packed.extract(walks[1], tmp_path)))) == 20
    assert packed.read("still.mkv") == still.read_bytes() != packed.read("still.rectified.mkv")


# ---- what it bears ---------------------------------------------------------------------------------------


def test_cancelled_and_killed_while_frames_are_written(tmp_path: Path, long_walk: Path) -> None:
    """The next server removes what lay in the temporary folder of one that was killed."""
    home = tmp_path / "home"
    with served(home) as server, server.client() as client:
        id = opened(client, long_walk, "clips")
        task = saving(client, [{"id": id, "options": RATIO}], "file")
        _wait_for_frames(client, task)
        (left,) = temporary_folders(home)
        assert client.delete(f"/api/saves/{task}").json()["state"] == "cancelled"
        assert not list(left.glob("saving-*"))
        assert client.get(f"/api/clips/{id}/before").status_code == 200
        _wait_for_frames(client, saving(client, [{"id": id, "options": RATIO}], "file"))
        server.kill()
    with served(home):
        assert not left.exists() and len(temporary_folders(home)) == 1


def _sound_alone(path: Path) -> Path:
    with av.open(str(path), "w") as out:
        stream = out.add_stream("aac", rate=48000)
        clips._ring(out, stream, 0)
        out.mux(stream.encode(None))
    return path


def test_clips_that_cannot_be_used(client: httpx.Client, walk: Path, tmp_path: Path) -> None:
    sound = _sound_alone(tmp_path / "sound.mp4")
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(walk.read_bytes()[: walk.stat().st_size * 2 // 3])
    letter = tmp_path / "letter.mp4"
    letter.write_text("no video" * 100)
    for path, told in (
        (sound, "contains no video"),
        (cut, "cannot read the clip"),
        (letter, "no video that can be read"),
    ):
        id = opened(client, path, "clips")
        _refused(client.get(f"/api/clips/{id}/before"), 422, told)
        assert told in _told_of(client, id)["error"]


def test_a_clip_that_ends_too_soon_is_not_saved(client: httpx.Client, tmp_path: Path) -> None:
    """Its tables come first, so that it can be looked at."""
    whole = clips.write(tmp_path / "walk.mp4", GREYS, container={"movflags": "faststart"}).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) * 2 // 3])
    told = _told_of(client, opened(client, tmp_path / "cut.mp4", "clips"))
    assert "the clip" in told["error"] and "/" not in told["error"] and "\n" not in told["error"]
    assert client.get(f"/api/saves/{told['task']}/file").status_code == 404


def test_requests_that_are_refused(client: httpx.Client, walk: Path) -> None:
    id = opened(client, walk, "clips")
    _refused(client.get(f"/api/clips/{id}/before", params={"moment": "5"}), 400, "'moment' takes 0 to 4")
    _refused(client.get(f"/api/clips/{id}/after", params={"readout-ms": "40"}), 400, "33.33 ms apart")
    _refused(client.get(f"/api/clips/{id}/after", params={"save-motion": "/tmp/x"}), 400, "unknown field")
    _refused(client.get(f"/api/clips/{id}/after", params=RATIO | {"start": "30"}), 422, "no frames in this part")
    _refused(client.get(f"/api/photos/{id}/after", params=RATIO | {"before": id}), 400, "walk.mp4 is a clip")
    two = [{"id": id}, {"id": id}]
    _refused(client.post("/api/saves", json={"to": "file", "photos": two}), 400, "choose zip")
    nameless = sent(client, "walk", walk.read_bytes(), "clips")
    assert "has no extension" in _told_of(client, nameless)["error"]


def test_a_playlist_is_no_clip(client: httpx.Client, walk: Path, tmp_path: Path) -> None:
    """It would have the decoder open other files of this machine, or fetch something."""
    playlist = tmp_path / "list.mp4"
    (tmp_path / walk.name).write_bytes(walk.read_bytes())
    for text in (
        f"#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{walk}\n#EXT-X-ENDLIST\n",
        f"ffconcat version 1.0\nfile '{walk.name}'\n",
    ):
        playlist.write_text(text)
        id = opened(client, playlist, "clips")
        _refused(client.get(f"/api/clips/{id}/before"), 422, "no video that can be read")


def test_too_large_and_without_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    with desk(Settings(token=TOKEN, max_mb=2)) as one:
        client = Asking(application(one, TOKEN, 80))
        _refused(client.post("/api/clips", content=bytes(4_000_000), headers=KNOWN), 413, "more than 2 MB")
        monkeypatch.setattr(app, "_clips_can_be_opened", lambda: False)
        _refused(client.post("/api/clips", content=b"x", headers=KNOWN), 422, version.extra("video"))
        assert client.get("/api/about", headers=KNOWN).json()["clips"] is False
        assert not list(one.store.folder.glob("*/clip*"))


def test_clips_may_be_larger_than_photos() -> None:
    usual, own = Settings(token=TOKEN), Settings(token=TOKEN, max_mb=30)
    assert (usual.max_bytes, usual.max_clip_bytes) == (400_000_000, 4_000_000_000)
    assert (own.max_bytes, own.max_clip_bytes) == (30_000_000, 30_000_000)


def test_no_room_on_the_disc() -> None:
    with desk() as one:
        client = Asking(application(one, TOKEN, 80))
        one.store.most_bytes = 1000
        answer = client.post("/api/clips", content=bytes(2000), headers=KNOWN)
        _refused(answer, 413, "close some of them")


def test_a_clip_at_which_nothing_moves_is_given_up(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, long_walk: Path
) -> None:
    monkeypatch.setattr(saves, "_STANDSTILL_S", -1.0)  # at once, where nothing changes between two looks
    monkeypatch.setattr(saves, "_LOOK_S", 0.01)

    async def run(one) -> saves.Saving:
        stored = await one.store.add("walk.mp4", _pieces(long_walk.read_bytes()), "clip")
        task = saves.Saving("x", "file", tmp_path / "results", [(stored, RectifyClip())])
        (tmp_path / "results").mkdir()
        await task.run(one)
        return task

    with desk() as one:
        task = asyncio.run(run(one))
    assert "no progress" in task.done[0]["error"] and task.result is None


async def _pieces(data: bytes):
    yield data


# ---- options ---------------------------------------------------------------------------------------------


def test_the_same_as_on_the_command_line() -> None:
    given = RATIO | {"strength": "0.5", "edges": "crop", "start": "1.5", "codec": "ffv1", "readout": "bottom-to-top"}
    words = [word for name, value in given.items() for word in (f"--{name}", value)]
    assert read_clip(given) == parse("video", VIDEO, ["clip.mp4", "-o", "out.mp4", *words]).options


def test_what_is_for_the_command_line_alone() -> None:
    names = {field.name for field in fields(RectifyClip)}
    assert {"readout-ms", "strength", "edges", "start", "end", "codec"} <= names
    assert not names & {"motion", "save-motion", "save-gyro", "preview", "plot", "overwrite", "json-log", "fps"}
    with pytest.raises(UsageError, match="unknown field 'json-log'"):
        read_clip({"json-log": "/etc/passwd"})
