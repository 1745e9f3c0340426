"""Measures methods on the places that come with the laboratory, and writes docs/results/places.md: ``make benchmark``.

    python lab/benchmarks/places.py [--estimators none,segment-manhattan] [--answers FOLDER ...] [--jobs 2]

Needs no data but the repository. It goes on where it was stopped, and methods may be added to a finished run.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from result_pages import write_page
from results import BUILD, DOCS, RUNS

from unshutter_lab.evaluation.results import Results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--estimators", default="all")
    parser.add_argument("--answers", nargs="+", default=[])
    parser.add_argument("--photos", help="at most so many places: for a quick look")
    parser.add_argument("--jobs")
    parser.add_argument("--docs", type=Path, default=DOCS)
    given = parser.parse_args()
    _, _, options = RUNS["places"]
    words = ["evaluate", "--protocol", "places", "--estimators", given.estimators, "--output", str(BUILD / "places")]
    words += [str(word) for option in options.items() for word in option]
    words += ["--answers", *given.answers] if given.answers else []
    for option, value in (("--photos", given.photos), ("--jobs", given.jobs)):
        words += [option, value] if value else []
    done = subprocess.run([sys.executable, "-m", "unshutter", *words, "--overwrite"])
    if done.returncode:
        sys.exit(f"places: stopped; what was measured is kept in {BUILD / 'places'}")
    given.docs.mkdir(parents=True, exist_ok=True)
    write_page("places", Results.load(BUILD / "places" / "results.json"), given.docs)
    print(f"wrote {given.docs}/places.md")


if __name__ == "__main__":
    main()
