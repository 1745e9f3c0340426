"""``unshutter synthesize``: pictures with known motion from many photos."""

from __future__ import annotations

from pathlib import Path

from unshutter.batch.inputs import find_photos
from unshutter.batch.report import exit_code
from unshutter.progress import Progress
from unshutter_lab.synthesis.options import Synthesize


def synthesize_files(photos: list[Path], output: Path, pictures: Synthesize) -> int:
    """Synthesises rolling-shutter pictures from photos; returns the exit code."""
    from unshutter_lab.synthesis.pair_folder import synthesize_folder

    inputs = find_photos(photos, leave_out=output)
    files = [photo for photo in inputs.photos if isinstance(photo, Path)]
    with Progress(len(files)) as bar:
        failed = synthesize_folder(files, output, pictures, bar.advance)
        for photo, message in failed:
            bar.tell(f"unshutter: {photo}: {message}")
        if inputs.passed_over:
            bar.tell(f"unshutter: {inputs.not_taken()}")
    return exit_code(len(failed), len(files))
