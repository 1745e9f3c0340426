"""How long a photographer waits for the page of ``unshutter serve``, in a real browser, beside the command line.

    python benchmarks/bench_page.py [--runs 7] [--megapixels 12]

The photo is the shipped one with rolling shutter, enlarged, as a JPEG. Measured: from the start of the command to the
first answer; the memory (resident, of all its processes) before a photo, with one open, and after a rest; from the
photo's arrival in the browser until the first picture is on the screen, and until both are, before and after; from a
change of the strength until its picture is there; saving, beside ``unshutter rectify``, in turn; and from a clip's
arrival (the shipped one, enlarged to 1440 x 1080 and four times as long) until its first picture: in H.264, which
browsers draw, and in H.265, which many cannot. The size is that of what ``pip install 'unshutter[web]'`` adds.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from fractions import Fraction
from pathlib import Path

import av
import pyvips
from playwright.sync_api import Page, sync_playwright

EXAMPLES = Path(__file__).parent.parent / "examples"
PHOTO = EXAMPLES / "demo.jpg"
CODECS = ("libx264", "libx265")
TOKEN = "benchmark"
EXTRA = ("starlette", "uvicorn", "anyio", "idna", "click", "h11", "typing_extensions")
FIRST = """() => new Promise((done) => {
    const look = () => {
        const image = document.querySelector(".layer.before img[src]");
        if (image) image.decode().then(() => done(performance.now()));
        else requestAnimationFrame(look);
    };
    look();
})"""
SHOWN = """() => new Promise((done) => {
    const item = () => document.querySelector(".thumbnail")?.dataset.state;
    const image = (which) => document.querySelector(`.layer.${which} img`);
    const look = () => {
        const images = ["before", "after"].map(image);
        const ready = item() === "changed" && images.every((each) => each.complete && each.src);
        if (ready) Promise.all(images.map((each) => each.decode())).then(() => done(performance.now()));
        else requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
})"""
CHANGED = """() => new Promise((done) => {
    const image = document.querySelector(".layer.after img");
    const began = performance.now();
    image.addEventListener("load", () => done(performance.now() - began), { once: true });
    const strength = document.getElementById("strength");
    strength.value = strength.value === "100" ? "50" : "100";
    strength.dispatchEvent(new Event("input"));
})"""


def memory_mb(pid: int) -> float:
    """Resident memory of a process and those that it started."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    own = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(own.split()[1]) / 1000 + sum(memory_mb(int(child)) for child in children)


def start() -> tuple[subprocess.Popen, str, float]:
    """The server, its address, and how long it took to answer [s]."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "unshutter", "serve", "--port", "0", "--token", TOKEN]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    link = process.stdout.readline().split()[1]
    urllib.request.urlopen(link).read()
    return process, link, time.perf_counter() - began


def dropped(page: Page, link: str, file: Path, *until: str) -> list[float]:
    """From a file's arrival to what scripts wait for [s]."""
    page.goto(link)
    page.wait_for_timeout(1500)  # somebody looks for the photo in a folder
    page.evaluate("() => addEventListener('change', () => (window.began = performance.now()), { capture: true })")
    page.mouse.click(5, 5)  # as a drag would, it wakes the program
    page.wait_for_timeout(1500)
    page.set_input_files("#choose", file)
    return [(page.evaluate(script) - page.evaluate("window.began")) / 1000 for script in until]


def enlarged_clip(file: Path, codec: str) -> Path:
    """The shipped clip at the height of Full HD, four times as long."""
    with av.open(str(EXAMPLES / "walk.mp4")) as source, av.open(str(file), "w") as target:
        frames = [frame.reformat(1440, 1080, format="yuv420p") for frame in source.decode(video=0)]
        stream = target.add_stream(codec, rate=30, options={"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 1440, 1080, "yuv420p"
        for number, frame in enumerate(frames * 4):
            frame.pts, frame.time_base = number, Fraction(1, 30)
            target.mux(stream.encode(frame))
        target.mux(stream.encode(None))
    return file


def stop(process: subprocess.Popen) -> None:
    process.terminate()
    process.wait()


def saved(page: Page) -> float:
    began = time.perf_counter()
    with page.expect_download() as download:
        page.click("#saveOne")
    download.value.path()
    return time.perf_counter() - began


def rectified(photo: Path) -> float:
    began = time.perf_counter()
    command = [sys.executable, "-m", "unshutter", "rectify", photo, "-o", photo.with_name("out.jpg"), "--overwrite"]
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
    return time.perf_counter() - began


def size_mb() -> float:
    files = [file for name in EXTRA for file in importlib.metadata.files(name) or []]
    return sum(path.stat().st_size for file in files if (path := Path(str(file.locate()))).exists()) / 1e6


def spread(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f} … {max(values):.2f}) s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--megapixels", type=float, default=12)
    parser.add_argument("--browser", default="/usr/bin/chromium")
    given = parser.parse_args()
    names = ("start", "first", "shown", "changed", "saved", "command", *CODECS)
    times: dict[str, list[float]] = {name: [] for name in names}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        photo = Path(folder) / "photo.jpg"
        original = pyvips.Image.new_from_file(str(PHOTO))
        original.resize((given.megapixels * 1e6 / (original.width * original.height)) ** 0.5).jpegsave(str(photo), Q=92)
        clips = {codec: enlarged_clip(Path(folder) / f"{codec}.mp4", codec) for codec in CODECS}
        browser = playwright.chromium.launch(executable_path=given.browser, args=["--no-sandbox"])
        for _ in range(given.runs + 1):
            process, link, took = start()
            idle = memory_mb(process.pid)
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            times["start"].append(took)
            for name, seconds in zip(("first", "shown"), dropped(page, link, photo, FIRST, SHOWN), strict=True):
                times[name].append(seconds)
            times["changed"].append(page.evaluate(CHANGED) / 1000)
            page.evaluate(CHANGED)
            times["saved"].append(saved(page))
            times["command"].append(rectified(photo))
            busy = memory_mb(process.pid)
            page.close()
            stop(process)
            for codec, clip in clips.items():
                process, link, _ = start()
                page = browser.new_page(viewport={"width": 1440, "height": 900})
                times[codec] += dropped(page, link, clip, FIRST)
                page.close()
                stop(process)
        browser.close()
    for values in times.values():
        del values[0]  # the warm-up
    ratio = statistics.median(a / b for a, b in zip(times["saved"], times["command"], strict=True))
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {given.runs} runs, ", end="")
    print(f"{given.megapixels:g} MP JPEG: median (least … most)")
    print(f"start to the first answer: {spread(times['start'])}")
    print(f"photo to first picture:    {spread(times['first'])}")
    for codec in CODECS:
        print(f"clip to first picture:     {spread(times[codec])}, {codec}")
    print(f"photo to before and after: {spread(times['shown'])}")
    print(f"strength to its picture:   {spread(times['changed'])}")
    print(f"saving:                    {spread(times['saved'])}, of `unshutter rectify`'s {ratio:.2f}")
    print(f"`unshutter rectify`:       {spread(times['command'])}")
    print(f"memory before a photo: {idle:.0f} MB; with a photo open: {busy:.0f} MB")
    print(f"the extra `web`: {size_mb():.1f} MB")


if __name__ == "__main__":
    main()
