"""A whole clip: its readout time, its motion, its frames, its file."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Iterable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.ratio import ReadoutRatio
from unshutter.frames.sequence import CameraMotion
from unshutter.geometry.readout import Readout
from unshutter.progress import Progress, Watch
from unshutter.storage.files import written_whole
from unshutter.storage.new_folders import new_folder
from unshutter.video import motion_file, mp4_film, pictures
from unshutter.video.background import ahead, side_by_side
from unshutter.video.clip import Clip
from unshutter.video.dense import beside_each_other
from unshutter.video.encoders import Encoder
from unshutter.video.frames_out import Warper, common_window
from unshutter.video.moving import FEWEST, Moved, window, with_motion
from unshutter.video.options import RectifyClip
from unshutter.video.outcome import Done, plot, tell
from unshutter.video.preview import write_preview
from unshutter.video.readout_search import found_or_listed
from unshutter.video.targets import are_pictures, check_targets, on_this_machine
from unshutter.video.writing import Film, writing
from unshutter.warp.pixels import thread_count

_MP4 = {".mp4", ".mov", ".m4v", ".3gp", ".3g2"}
_DECODED_AHEAD = 2  # frames; each is in memory
_LINKED_AHEAD = 1  # the same


def rectify_clip(
    source: str, output: str, wanted: RectifyClip, found: ReadoutRatio | None = None, watch: Watch | None = None
) -> Done:
    """Writes a clip as a global shutter would have taken it.

    Args:
        source: a film, a folder of pictures, or a pattern of their names.
        output: a file, or a folder or pattern for pictures.
        wanted: what is done.
        found: the readout ratio that was found before (:func:`found_or_listed`), where none is given.
        watch: is told of every frame.

    Raises:
        UsageError: options that do not fit the clip.
        UnshutterError: the clip cannot be read, its readout time not be told, or the output not be written.
    """
    cv2.setNumThreads(1)  # the threads are in the pipeline
    given, source, target = source, on_this_machine(source), Path(on_this_machine(output))
    log = check_targets(source, target, wanted)
    clip = Clip.look(source, wanted.fps, wanted.max_pixels)
    if wanted.fps is not None and not clip.of_pictures:
        raise UsageError("--fps is for sequences of pictures: a film says it itself")
    clip.check_whole(wanted.start, wanted.end)
    known = motion_file.load(wanted.motion) if wanted.motion is not None else None
    encoder = Encoder.choose(clip, wanted.encode) if not are_pictures(target) else None
    ratio, readout = _readout(clip, wanted, known, found)
    work = _Work(clip, wanted, ratio, readout, known, encoder, watch)
    work.warper = Warper(clip, wanted.undo)
    if wanted.undo.edges == "crop":
        with closing(work.moved(all_streams=False)) as moved, Progress(clip.frames or 2, "looking", watch) as progress:
            work.warper = Warper(clip, wanted.undo, common_window(work.warper, _counted(moved, progress)))
    done = pictures_out(work, target) if are_pictures(target) else _film_out(work, target)
    if wanted.preview is not None:
        write_preview(wanted.preview, clip, str(target), wanted.start or 0.0, done.frames, wanted.overwrite)
    if wanted.plot is not None:
        plot(wanted.plot, source, done, ratio.value * clip.interval_s, wanted.overwrite)
    tell(given, output, done, ratio, clip, wanted, log)
    return done


@dataclass
class _Work:
    """What the steps of a run share."""

    clip: Clip
    wanted: RectifyClip
    ratio: ReadoutRatio
    readout: Readout
    known: motion_file.ClipMotion | None
    encoder: Encoder | None  # None: pictures
    watch: Watch | None
    warper: Warper = field(init=False)

    def moved(self, all_streams: bool) -> Generator[Any]:
        """Frames with their motion, and packets of the other streams."""
        items = ahead(self.clip.items(self.wanted.start, self.wanted.end, all_streams), _DECODED_AHEAD)
        if self.known is not None:
            return _with_known(self.known, items)
        together = window(self.clip)
        focal_px = self.wanted.shutter.focal_px
        camera = CameraMotion(self.ratio, focal_px, self.readout, window=together, fewest=FEWEST)
        return ahead(with_motion(self.clip, items, camera), together[0])  # while the next are looked at

    def made(self, all_streams: bool) -> Generator[tuple[Any, Any]]:
        """(frame with its motion or packet, frame to encode) in order."""
        items, undo = self.moved(all_streams), self.wanted.undo
        if undo.model == "dense" and undo.strength:
            beside = beside_each_other(self.clip, items, self.ratio.value, self.readout, undo.edges == "borrow")
            items = ahead(beside, _LINKED_AHEAD)
        return side_by_side(self.warper, items, thread_count())


def _with_known(known: motion_file.ClipMotion, items: Iterable[Any]) -> Generator[Any]:
    from unshutter.video.library import av

    for item in items:
        if isinstance(item, av().VideoFrame):
            yield Moved(item, *known.at(item.time or 0.0))
        else:
            yield item


def _film_out(work: _Work, target: Path) -> Done:
    """Writes a film: the frames into a file of their own where they are put into a copy of the one that came in."""
    clip, wanted, done = work.clip, work.wanted, Done()
    whole = wanted.start is None and wanted.end is None
    grafted = whole and _same_family(clip.path, target) and mp4_film.can_take(clip.path)
    with ExitStack() as stack:
        part = stack.enter_context(written_whole(target, wanted.overwrite))
        motions = stack.enter_context(
            motion_file.motion_written(wanted.save_motion, wanted.overwrite, clip, work.ratio, work.readout)
        )
        source = stack.enter_context(clip.opened())
        frames = stack.enter_context(tempfile.TemporaryFile(dir=target.parent)) if grafted else None
        place = frames if frames is not None else part
        container = stack.enter_context(writing(place, target.suffix, clip.ticks))
        made = stack.enter_context(closing(work.made(all_streams=not grafted)))
        assert work.encoder is not None
        film = Film(container, source, clip, work.encoder, not grafted, work.warper.size, wanted.start or 0.0)
        with Progress(clip.frames or 2, "frames", work.watch) as progress:
            for item, frame in made:
                if not isinstance(item, Moved):
                    film.add_packet(item)
                    continue
                done.add(item)
                if motions is not None:
                    motions.add(item)
                film.add_frame(frame)
                progress.advance()
        if not done.frames:
            raise UnshutterError(f"{clip.path} has no frames there")
        film.end()
        done.left_out = film.left_out
        if frames is not None:
            with open(clip.path, "rb") as original, part.open("r+b") as out:
                mp4_film.write_with_film(original, frames, out)
    return done


def pictures_out(work: _Work, target: Path) -> Done:
    """Writes pictures into a new folder, which gets its name when all of them are there."""
    clip, wanted, done = work.clip, work.wanted, Done()
    folder, name = pictures.folder_and_name(target, clip.pictures)
    with ExitStack() as stack:
        part = stack.enter_context(new_folder(folder))
        motions = stack.enter_context(
            motion_file.motion_written(wanted.save_motion, wanted.overwrite, clip, work.ratio, work.readout)
        )
        made = stack.enter_context(closing(work.made(all_streams=False)))
        with Progress(clip.frames or 2, "frames", work.watch) as progress:
            for item, frame in made:
                done.add(item)
                if motions is not None:
                    motions.add(item)
                pictures.write(frame, part / (name % done.frames))
                progress.advance()
        if not done.frames:
            raise UnshutterError(f"{clip.path} has no frames there")
    return done


# ---- before and after -------------------------------------------------------------------------------------


def _readout(
    clip: Clip, wanted: RectifyClip, known: motion_file.ClipMotion | None, found: ReadoutRatio | None
) -> tuple[ReadoutRatio, Readout]:
    """The readout ratio and direction: from the motion file, given, or found."""
    readout = Readout.parse(wanted.shutter.readout)
    if known is not None:
        if (known.height, known.width) != (clip.height, clip.width):
            raise UnshutterError(
                f"the motion file is of frames of {known.width}x{known.height} px, the clip has "
                f"{clip.width}x{clip.height}: it is of another clip"
            )
        return ReadoutRatio(known.ratio, 0.0, "motion file"), known.readout
    ratio = wanted.shutter.ratio(clip.interval_s)
    if ratio is not None:
        return ReadoutRatio(ratio, 0.0, "given"), readout
    return found or found_or_listed(clip, readout, wanted.shutter, wanted.span(clip.duration_s)), readout


def _same_family(source: str, target: Path) -> bool:
    return Path(source).suffix.lower() in _MP4 and target.suffix.lower() == Path(source).suffix.lower()


def _counted(items: Iterable[Any], progress: Progress) -> Iterator[Any]:
    for item in items:
        progress.advance()
        yield item
