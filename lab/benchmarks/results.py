"""Measures everything that docs/results says, and writes it: ``make results DATA=../shared/data``.

    python lab/benchmarks/results.py DATA [--estimators all] [--jobs 2] [--most N]
    python lab/benchmarks/results.py --pages-only          # writes the pages again from build/results
    python lab/benchmarks/results.py DATA --only real-clips     # measures these runs, and writes their pages alone

DATA is a folder with test/yorkurban, test/eurasiancities, test/urban100, val, real/{bsrsc,fastec,carla}, video/real
and trajectories, none of which are part of the repository. Every run is an ``unshutter evaluate`` into build/results,
and goes on where it was stopped; one that was made by other code is measured again. How many photos each takes is
chosen so that all together stay within two hours on two cores.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from result_pages import write_page, write_pages

from unshutter_lab.evaluation.results import Results

ROOT = Path(__file__).parents[2]
BUILD = Path("build/results")
DOCS = Path("docs/results")
TEST = ["test/yorkurban", "test/eurasiancities", "test/urban100"]
REAL = ["real/bsrsc", "real/fastec", "real/carla"]
OURS = {"--estimators": "none,segment-manhattan,manhattan"}  # the methods that use what photos say beside their pixels
# name of the run -> (protocol, folders of DATA, options)
RUNS = {
    "places": ("places", [], {"--per-photo": 2}),
    "synthetic": ("synthetic", [*TEST, "val"], {"--photos": 40, "--per-photo": 2}),
    "native": ("native", [*TEST, "val"], {"--photos": 25, "--per-photo": 1}),
    "trajectory": ("trajectory", [*TEST, "val"], {"--photos": 15, "--per-photo": 1}),
    "undistorted": ("undistorted", [*TEST, "val"], {"--photos": 25}),
    "portrait": ("portrait", [*TEST, "val"], {"--photos": 25, "--per-photo": 1, **OURS}),
    "exposure": ("exposure", TEST, {"--photos": 15, "--per-photo": 1, **OURS}),
    "attitude": ("attitude", [*TEST, "val"], {"--photos": 20, "--per-photo": 1, **OURS}),
    "robustness": ("robustness", TEST, {"--photos": 10, "--per-photo": 1}),
    "pairs": ("pairs", REAL, {"--readout-ratio": "0.42 0.97 1"}),  # of BS-RSC, Fastec and Carla
    "sequences": ("sequences", ["test/yorkurban"], {"--photos": 5, "--per-photo": 1}),
    "video": ("video", REAL, {}),
    "rendered-clips": ("rendered-clips", [], {"--estimators": "all"}),
    "real-clips": ("real-clips", ["video/real"], {"--estimators": "all"}),
}
# photos of scikit-image without buildings: any motion found is wrong, as in all undistorted photos
OTHERS = ["astronaut", "rocket", "camera", "gravel", "page", "grass", "chelsea", "coffee"]
BENCHES = {
    "estimators": ["bench_estimators.py", "--rounds", "3"],
    "rectify": ["bench_rectify.py", "--runs", "5"],
    "clips": ["bench_clips.py", "--runs", "2"],
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", help="folder of the photos and logs")
    parser.add_argument("--estimators", default="all")
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--most", type=int, help="at most so many photos of each folder: for a quick look")
    parser.add_argument("--docs", type=Path, default=DOCS)
    parser.add_argument("--pages-only", action="store_true")
    parser.add_argument(
        "--only", nargs="+", choices=RUNS, default=[], help="measure these, and write their pages alone"
    )
    given = parser.parse_args()
    if not given.pages_only:
        _check(given.data, given.only)
        for name, words in _commands(given.data, given.most):
            if given.only and name not in given.only:
                continue
            words += [] if "--estimators" in words else ["--estimators", given.estimators]
            words += ["--output", str(BUILD / name), "--overwrite"]
            _run([sys.executable, "-m", "unshutter", *words, *(["--jobs", str(given.jobs)] if given.jobs else [])])
        for name, words in BENCHES.items() if not given.only else ():
            rounds = {"estimators": ["--estimators", given.estimators], "clips": [str(given.data / "video/real")]}
            rounds = rounds.get(name, [])
            text = _run([sys.executable, f"{ROOT}/benchmarks/{words[0]}", *words[1:], *rounds], keep=True)
            (BUILD / f"{name}.md").write_text(f"```sh\npython benchmarks/{' '.join(words)}\n```\n\n{text}")
    for name in given.only:
        write_page(name, Results.load(BUILD / name / "results.json"), given.docs)
        print(f"wrote {given.docs}/{name}.md")
    if not given.only:
        write_pages(BUILD, given.docs)


def _check(data: Path | None, only: list[str]) -> None:
    if data is None:
        sys.exit("results: say where the photos are: make results DATA=../shared/data")
    needed = [folder for name in only or RUNS for folder in RUNS[name][1]]
    needed = list(dict.fromkeys([*needed, "trajectories"] if not only else needed))
    missing = [name for name in needed if not (data / name).is_dir()]
    if missing:
        sys.exit(f"results: no folder {data / missing[0]}: DATA must hold {', '.join(needed)}")


def _commands(data: Path, most: int | None) -> Iterator[tuple[str, list[str]]]:
    """(name, words of ``unshutter``) of each run."""
    for name, (protocol, folders, options) in RUNS.items():
        words = ["evaluate", "--protocol", protocol]
        words += ["--data", *(str(data / folder) for folder in folders)] if folders else []
        if protocol in ("trajectory", "sequences"):
            words += ["--trajectory", str(data / "trajectories")]
        for option, value in options.items():
            words += [option, *str(min(value, most) if most and option == "--photos" else value).split()]
        yield name, words
    yield "others", ["evaluate", "--protocol", "undistorted", "--data", str(_photos_of_scikit_image())]
    examples = ["--data", "examples/original", "--per-photo", "12", "--seed", "1"]
    yield "examples", ["evaluate", "--protocol", "synthetic", *examples]


def _photos_of_scikit_image() -> Path:
    """Returns a folder of them."""
    import skimage.data

    from unshutter.photo import Photo

    folder = BUILD / "photos" / "scikit-image"
    folder.mkdir(parents=True, exist_ok=True)
    for name in OTHERS:
        Photo.from_array(getattr(skimage.data, name)()).save(folder / f"{name}.png", overwrite=True)
    return folder


def _run(command: list[str], keep: bool = False) -> str:
    print("+", *(word if word != sys.executable else "python" for word in command), flush=True)
    done = subprocess.run(command, stdout=subprocess.PIPE if keep else None, text=True)
    if done.returncode:
        sys.exit(f"results: stopped; what was measured is kept in {BUILD}")
    return done.stdout or ""


if __name__ == "__main__":
    main()
