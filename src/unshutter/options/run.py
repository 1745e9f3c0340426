"""Options for how a command processes its photos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from unshutter.errors import UsageError
from unshutter.options.description import option

_LONGEST_TIMEOUT_S = 86_400  # one day
MAX_PIXELS = 1_000_000_000  # per photo, unless the user allows more


@dataclass(frozen=True)
class Run:
    """How a command works through its photos; none of this changes the results.

    Attributes:
        overwrite: whether existing outputs may be replaced; originals never are.
        jobs: number of processes on this machine; None: this process.
        scheduler: address of a Dask scheduler; None: none.
        dry_run: only report what would be done.
        json_log: file to append events to, one JSON object per line.
        manifest: folder for the manifest; None: that of the results.
        preview: picture of all photos before and after, side by side; None: none.
        max_pixels: photos with more pixels are refused.
        timeout: time limit per photo [s]; None: half an hour if processes do the work, otherwise no limit. With a limit
            but without ``jobs``, one other process does the work, because a decoder that hangs cannot be stopped in
            this one.

    Raises:
        UsageError: a number is below 1, both ``jobs`` and ``scheduler`` are set, or a time limit with a scheduler.
    """

    overwrite: bool = option(False, "Replace existing outputs, including finished ones.")
    jobs: int | None = option(None, "Number of processes, each on one processor. Default: a single process.")
    scheduler: str | None = option(
        None,
        "Address (tcp://HOST:PORT) of a Dask scheduler; its workers do the work (needs the extra `dask`).",
        names="word",
    )
    dry_run: bool = option(False, "List what would be done without writing anything.")
    json_log: Path | None = option(
        None, "Append a log of the run to this file, one JSON object per line.", names="output"
    )
    manifest: str | None = option(
        None,
        "Keep the list of finished results (unshutter-manifest.jsonl) in this folder. Default: next to the results.",
        metavar="FOLDER",
        names="output",
    )
    preview: Path | None = option(
        None,
        "Also write this picture: before and after, side by side; for a folder, a contact sheet of all its photos.",
        metavar="FILE",
        names="output",
    )
    max_pixels: int = option(MAX_PIXELS, "Refuse photos with more pixels. Default: 1 000 000 000.")
    timeout: float | None = option(
        None,
        "Give up on a photo that takes longer, and go on with the next. Default: 1800 with --jobs, else none.",
        metavar="SECONDS",
    )

    def __post_init__(self) -> None:
        if self.timeout is not None and not 0 < self.timeout <= _LONGEST_TIMEOUT_S:
            raise UsageError(f"--timeout must lie between 0 and {_LONGEST_TIMEOUT_S} s, got {self.timeout:g}")
        if self.timeout is not None and self.scheduler is not None:
            raise UsageError("--timeout is for this machine: the workers of a scheduler have limits of their own")
        if self.jobs is not None and self.jobs < 1:
            raise UsageError(f"--jobs must be at least 1, got {self.jobs}")
        if self.max_pixels < 1:
            raise UsageError(f"--max-pixels must be at least 1, got {self.max_pixels}")
        if self.jobs is not None and self.scheduler is not None:
            raise UsageError("--jobs is for this machine, --scheduler for a cluster: choose one")
