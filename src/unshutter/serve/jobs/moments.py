"""Jobs on single moments of a clip: frames before and after for the screen, upright, with facts about them."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.serve.jobs.cache import OpenFile, errors_of, put
from unshutter.serve.jobs.clip import digest, ratio_of
from unshutter.video.options import RectifyClip

if TYPE_CHECKING:
    import numpy as np
    from av import VideoFrame

    from unshutter.reasons import Reason
    from unshutter.video.clip import Clip
    from unshutter.video.frame_motion import MovingFrame

MOMENTS = 5  # of a clip that are shown
_BESIDE = 12  # frames on both sides of a moment from which its motion is found


def before(open_file: OpenFile, wanted: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """A frame of the clip as a JPEG for the screen, upright, and what the file says.

    Args:
        open_file: the clip.
        wanted: of it, only the part that is kept counts.
        moment: which of the moments, 0 ... MOMENTS - 1, evenly over that part.
        longest: longer side [px]; None: full size.

    Raises:
        UnshutterError: the clip cannot be read.
    """
    with errors_of(open_file):
        return _before(open_file, wanted, moment, longest)


def after(open_file: OpenFile, wanted: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """The same frame, straightened, and what was found and done. A part of the clip around it says how it moved.

    Edges that would be cropped are kept: what all frames saw is known when the whole clip was looked at.

    Raises:
        UsageError, UnshutterError: options that do not fit the clip, or it does not tell its readout time.
    """
    with errors_of(open_file):
        return _after(open_file, wanted, moment, longest)


def _before(open_file: OpenFile, wanted: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    from unshutter.serve.jobs.photo import as_jpeg
    from unshutter.video.clip import Clip

    clip = Clip.look(open_file.path)
    frame = _frame_at(clip, _time_of(clip, wanted, moment))
    height, width = _upright_size(frame, None)
    return as_jpeg(_seen(frame, longest)), {
        "height": height,
        "width": width,
        "duration_s": clip.duration_s,
        "fps": 1 / clip.interval_s,
        "frames": clip.frames,
        "moments_s": [_time_of(clip, wanted, k) for k in range(MOMENTS)],
    }


def _after(open_file: OpenFile, wanted: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    from dataclasses import replace

    from unshutter.geometry.readout import Readout
    from unshutter.motion.verdict import LEAST_PX
    from unshutter.serve.jobs.photo import as_jpeg
    from unshutter.video.clip import Clip
    from unshutter.video.frame_warper import Warper

    clip = Clip.look(open_file.path)
    undo = replace(wanted.undo, edges="keep") if wanted.undo.edges == "crop" else wanted.undo
    warper, moving = Warper(clip, undo), _moving_at(open_file, clip, wanted, _time_of(clip, wanted, moment))
    size = Readout.parse(wanted.shutter.readout).frame_size(clip.height, clip.width)
    motion = warper.motion(moving).resized(*size)
    pixels = _seen(warper.rectified(moving).picture, longest, like=moving.frame)
    return as_jpeg(pixels), {
        "changed": not motion.is_zero,
        **_reason_facts(moving.motion.reason),
        "largest_px": motion.largest_px,
        "tiny": motion.largest_px < LEAST_PX,
        "edges": wanted.undo.edges,
        "at_s": moving.frame.time or 0.0,
    }


def _time_of(clip: Clip, wanted: RectifyClip, moment: int) -> float:
    """Of a moment [s]: the middles of equal parts."""
    start, end = wanted.start or 0.0, min(wanted.end or clip.duration_s, clip.duration_s)
    return start + (moment + 0.5) / MOMENTS * max(end - start, 0.0)


def _frame_at(clip: Clip, at: float) -> VideoFrame:
    for frame in clip.iter_frames(max(at - clip.interval_s / 2, 0.0)):
        return frame
    raise UnshutterError(f"the clip has no frame at {at:.1f} s: its part ends before")


def _moving_at(open_file: OpenFile, clip: Clip, wanted: RectifyClip, at: float) -> MovingFrame:
    """The frame at a moment and its motion, which is kept beside the clip."""
    from unshutter.frames.sequence import CameraMotion
    from unshutter.geometry.readout import Readout
    from unshutter.motion import Motion
    from unshutter.video.frame_motion import FEWEST, MovingFrame, window, with_motion

    ratio = ratio_of(open_file, clip, wanted)
    file = open_file.path.with_name(f"moment-{digest(wanted.shutter, ratio, at)}.json")
    if file.exists():
        return MovingFrame(_frame_at(clip, at), Motion.from_json(file.read_text(encoding="utf-8")))
    readout = Readout.parse(wanted.shutter.readout)
    camera = CameraMotion(ratio, wanted.shutter.focal_px, readout, window=window(clip), fewest=FEWEST)
    first = max(at - _BESIDE * clip.interval_s, 0.0)
    for moving in with_motion(clip, islice(clip.iter_frames(first), 2 * _BESIDE + 1), camera):
        if isinstance(moving, MovingFrame) and (moving.frame.time or 0.0) >= at - clip.interval_s / 2:
            put(file, lambda part, motion=moving.motion: part.write_text(motion.to_json(), encoding="utf-8"))
            return moving
    raise UnshutterError(f"the clip has no frame at {at:.1f} s: its part ends before")


def _reason_facts(reason: Reason | None) -> dict[str, Any]:
    """Why the frame is left unchanged: the sentence, the reason's code, and its figures."""
    if reason is None:
        return {"reason": ""}
    about = reason.as_json()
    return {"reason": about["sentence"], "code": about["code"], "figures": about["figures"]}


# ---- frames as they are looked at ----------------------------------------------------------------------------


def _seen(frame: VideoFrame, longest: int | None, like: VideoFrame | None = None) -> np.ndarray:
    """[H, W, 3] RGB pixels of a frame, upright.

    Args:
        frame: as it is stored.
        longest: longer side [px]; None: full size.
        like: the frame that says how it is turned, where this one does not.
    """
    import numpy as np

    turns = _quarter_turns(like or frame)
    height, width = _upright_size(frame, longest, turns)
    size = (width, height) if turns % 2 == 0 else (height, width)
    pixels = frame.reformat(*size, format="rgb24").to_ndarray()
    return np.ascontiguousarray(np.rot90(pixels, turns))


def _upright_size(frame: VideoFrame, longest: int | None, turns: int | None = None) -> tuple[int, int]:
    """Height and width of a frame as it is looked at [px]."""
    height, width = (frame.height, frame.width)
    scale = 1.0 if longest is None else min(longest / max(height, width), 1.0)
    height, width = (max(2, round(side * scale)) for side in (height, width))
    return (height, width) if (_quarter_turns(frame) if turns is None else turns) % 2 == 0 else (width, height)


def _quarter_turns(frame: VideoFrame) -> int:
    """Anticlockwise, from how it is stored to how it is looked at."""
    return round(frame.rotation / 90)
