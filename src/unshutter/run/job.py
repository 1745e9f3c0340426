"""The work on photos: what is to be done to each, and what came of it. Nothing here needs NumPy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter import inventory
from unshutter.errors import UnshutterError
from unshutter.options import LEAST_GOOD_CROP, MAX_PIXELS, Edges, Find, Rectify
from unshutter.run.ahead import Begun, Wanted, look_ahead
from unshutter.storage.files import check_target
from unshutter.storage.locations import RunFiles
from unshutter.storage.objects import is_object
from unshutter.storage.targets import Target, TargetKind, Written

if TYPE_CHECKING:
    import numpy as np

    from unshutter.frames.frame_motion import FrameMotion
    from unshutter.motion.finding import Finding
    from unshutter.motion.verdict import Verdict
    from unshutter.readout_time import ReadoutRatio
    from unshutter.run.bursts import Burst


@dataclass(frozen=True)
class Job:
    """One photo, the places for its results, and what other photos show about it."""

    source: Path  # the photo
    targets: tuple[Target, ...]  # the files that may be written, one of each kind at most, its picture among them
    # whether an earlier attempt may have written outputs before its worker died or its run was killed; existing files
    # with identical bytes are then kept
    may_repeat: bool = False
    # its motion, found from its neighbours in a sequence; None: estimated, or shared by all photos
    motion: FrameMotion | None = None
    before: Path | None = None  # its neighbour before it in a sequence
    after: Path | None = None  # its neighbour after it
    burst: Burst | None = None  # what the photos taken just before and after it show; None: it is judged by itself
    folder_log_odds: float | None = None  # judged again in view of the other photos of its folder (run/folder.py)

    def target(self, kind: TargetKind) -> Target | None:
        """Returns the file of a kind; None: not written."""
        return next((target for target in self.targets if target.kind is kind), None)

    @property
    def picture(self) -> Path:
        """The path of its picture, if the photo is changed."""
        target = self.target(TargetKind.PICTURE)
        assert target is not None
        return target.path

    @property
    def outputs(self) -> list[Path]:
        """The paths that may be written, each once."""
        return list(dict.fromkeys(target.path for target in self.targets))

    def check_outputs(self, files: RunFiles, overwrite: bool, new_folders: bool = False) -> None:
        """Checks that its outputs may be written, as far as a quick check can tell; new folders will be created."""
        for target in self.targets:
            path = target.path
            if new_folders and not (is_object(path) or path.parent.is_dir()):
                continue
            files.check(path)
            # the worker checks the digest of what an earlier run may have written, and whether the file at the place of
            # a copy is such a copy
            known = target.left is not None or target.kind in (TargetKind.UNCHANGED, TargetKind.UNCHANGED_MASK)
            check_target(path, overwrite or self.may_repeat or known)


@dataclass(frozen=True)
class Work:
    """What is done to each photo of a run."""

    request: Rectify
    given: Finding | None = None  # the motion to undo in all photos; None: it is found
    max_pixels: int = MAX_PIXELS  # of a photo that is read
    overwrite: bool = False  # whether outputs may replace existing files
    is_recorded: bool = False  # whether a manifest needs digests of the outputs
    preview_px: int | None = None  # long side [px] of the before and after pictures, 0 for full size; None: no preview

    def begin(self, jobs: Sequence[Job]) -> Iterator[Begun]:
        """Returns the photos of these jobs, on each of which work begins while the previous one is processed."""
        return look_ahead([Wanted(job.source, self._find(job), self.request.undo, self.max_pixels) for job in jobs])

    def _find(self, job: Job) -> Find | None:
        """Returns how the motion of a photo is found from itself; None if it is not."""
        find = self.request.find_alone
        if find is None or self.given is not None or job.burst is not None:
            return None
        if job.folder_log_odds is None:
            return find
        return replace(find, decision=replace(find.decision, folder=job.folder_log_odds))


@dataclass(frozen=True)
class Outcome:
    """What came of a photo."""

    error: UnshutterError | None = None  # None: success
    model: str = ""  # motion model used for a photo with neighbours (rectification/sequences.py); otherwise empty
    verdict: Verdict | None = None  # whether the photo was changed, and why not
    edges: Edges | None = None  # how areas that the photo did not see were handled; None: unchanged
    ratio: ReadoutRatio | None = None  # readout ratio that was found, or taken, from a photo's neighbours
    area_left: float | None = None  # share of the photo's area that a crop leaves; None if no crop was computed
    seconds: float = 0.0  # duration of the work
    source_is: str | None = None  # fingerprint of the photo that was read
    written: tuple[Written, ...] = ()  # the files that were written
    group: str = ""  # folder, camera and hour of the photo
    preview: tuple[np.ndarray, np.ndarray] | None = None  # the before and after pictures for a preview

    @property
    def picture(self) -> Path | None:
        """The picture that was written; for an unchanged photo there may be none."""
        pictures = (TargetKind.PICTURE, TargetKind.UNCHANGED)
        return next((file.path for file in self.written if file.kind in pictures), None)

    @property
    def please_look(self) -> bool:
        """Whether someone should compare the result with the photo."""
        little_left = self.area_left is not None and self.area_left < LEAST_GOOD_CROP
        return little_left or (self.verdict is not None and self.verdict.needs_a_look)

    @property
    def left_out(self) -> list[str]:
        """Names of what the files that were written lack, each once."""
        return list(dict.fromkeys(name for file in self.written for name in file.left_out))

    @property
    def note(self) -> str:
        """What the user should know about the written files; usually empty."""
        notes = []
        for file in self.written:
            notes += [f"encoded as {file.encoded_as}"] if file.encoded_as else []
            notes += filter(None, [inventory.describe(file.left_out)])
        return "; ".join(notes)
