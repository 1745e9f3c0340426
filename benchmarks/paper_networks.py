"""Measures the paper's network beside others that the package does not ship, and writes a page of docs/results.

    python benchmarks/paper_networks.py DATA RUNS [--page paper-networks] [--jobs 2]

The page paper-networks is of the ablations, the page predecessor of rengarajan2017.
DATA as for results.py. RUNS holds networks as ``unshutter train`` leaves them: RUNS/NAME/model.onnx. Their weights are
not part of the repository (but for those of kandula2020), so ``make results`` leaves this page as it is.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from results import REAL, TEST

from unshutter.evaluation.pages.tables import tables
from unshutter.evaluation.results import Results

DOCS = Path("docs/results")  # PAGE-reading.md there is written by hand
RUNS = {
    "synthetic": ("Synthetic motions, 256 px", TEST, {"--photos": "40", "--per-photo": "2"}),
    "undistorted": ("Undistorted photos: do no harm", TEST, {"--photos": "25"}),
    "pairs": ("Real pairs", REAL, {}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--page", default="paper-networks")
    parser.add_argument("--jobs", default="2")
    given = parser.parse_args()
    networks = {path.parent.name: path for path in sorted(given.runs.glob("*/model.onnx"))}
    if not networks:
        sys.exit(f"paper_networks: no {given.runs}/NAME/model.onnx")
    names = {f"{name.partition('-')[0]}@{path}": name for name, path in networks.items()}
    parts = [(DOCS / f"{given.page}-reading.md").read_text().strip()]
    for protocol, (title, folders, options) in RUNS.items():
        words = ["evaluate", "--protocol", protocol, "--data", *(str(given.data / folder) for folder in folders)]
        words += [word for option in options.items() for word in option]
        words += ["--estimators", ",".join(["none", "kandula2020", *names])]
        output = Path("build", given.page, protocol)
        command = [sys.executable, "-m", "unshutter", *words, "-o", str(output), "--jobs", given.jobs, "--overwrite"]
        if subprocess.run(command).returncode:
            sys.exit(f"paper_networks: stopped; what was measured is kept in {output}")
        results = Results.load(output / "results.json")
        parts += [f"## {title}", f"```sh\n{results.command}\n```", tables(results)]
    text = "\n\n".join(parts)
    for word, name in names.items():
        text = text.replace(f"| {word} |", f"| {name} |")
    page = DOCS / f"{given.page}.md"
    page.write_text(text + "\n\n[All results](index.md)\n")
    print(f"wrote {page}")


if __name__ == "__main__":
    main()
