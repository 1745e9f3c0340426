"""``unshutter synthesize``: pictures with known motion from many photos."""

from __future__ import annotations

from pathlib import Path

from unshutter.batch.inputs import find_photos
from unshutter.batch.report import exit_code
from unshutter.progress import Progress


def synthesize_files(
    photos: list[Path],
    output: Path,
    per_photo: int,
    seed: int,
    motion: str,
    trajectory: Path | None,
    readout_ms: float | None,
    focal_px: float | None,
    size: int,
    canvas: int,
) -> int:
    """Makes rolling-shutter pictures from photos; returns the exit code."""
    from unshutter.synthesis.pairs import synthesize_folder

    files = [photo for photo in find_photos(photos, leave_out=output).photos if isinstance(photo, Path)]
    with Progress(len(files)) as bar:
        failed = synthesize_folder(
            files,
            output,
            per_photo=per_photo,
            seed=seed,
            motion=motion,
            trajectory=trajectory,
            readout_ms=readout_ms,
            focal_px=focal_px,
            size=size,
            canvas=canvas,
            progress=bar.advance,
        )
        for photo, message in failed:
            bar.tell(f"unshutter: {photo}: {message}")
    return exit_code(len(failed), len(files))
