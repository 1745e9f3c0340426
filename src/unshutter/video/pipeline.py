"""The processing steps of a clip's frames: decode, estimate motion, link with neighbours, warp.

Each step is a generator that runs ahead of the next in its own thread. Packets of the clip's other streams pass through
all of them, in their place between the frames.

    VideoFrame -> MovingFrame -> (LinkedFrame ->) NewFrame
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, Full, Queue
from typing import TYPE_CHECKING, Any, TypeVar

from unshutter.frames.self_calibration import ReadoutRatio
from unshutter.frames.sequence import CameraMotion
from unshutter.geometry.readout import Readout
from unshutter.gyro.rows import GyroTurns
from unshutter.motion import RowMotion
from unshutter.reasons import Reason
from unshutter.video.clip import Clip, SidePacket, frame_bytes
from unshutter.video.clip_motion_file import ClipMotion
from unshutter.video.frame_links import LinkedFrame, linked
from unshutter.video.frame_warper import NewFrame, Warper
from unshutter.video.moving_frames import FEWEST, ROWS, MovingFrame, window, with_motion
from unshutter.video.options import RectifyClip
from unshutter.video.stabilisation import Stabilisation
from unshutter.warp.pixels import thread_count

if TYPE_CHECKING:
    from av import VideoFrame

_LINKED_AHEAD = 1  # frames, all held in memory
_DECODED_AHEAD, _MOVING_AHEAD = 2, 8  # frames, if they are small
_AHEAD_BYTES = 25_000_000  # of frames queued between two steps
_T = TypeVar("_T")
_U = TypeVar("_U")
_END = object()
_ASK_S = 0.1  # interval at which a waiting step checks whether to stop


@dataclass(frozen=True)
class Pipeline:
    """The processing steps of a clip's frames.

    Attributes:
        clip: the clip.
        options: the part to keep, and how motion is undone.
        ratio: readout time in frame intervals.
        readout: direction in which stored pixels were read.
        file_motion: motion from a file; None to estimate it from the frames.
        unmoved: why no frame is changed; None if frames are rectified.
        gyro: the camera's rotation from a gyro; None to use only the frames.
        stabilisation: the frames' views and motion from a first pass; None if the camera's path is left unchanged.
    """

    clip: Clip
    options: RectifyClip
    ratio: ReadoutRatio
    readout: Readout
    file_motion: ClipMotion | None = None
    unmoved: Reason | None = None
    gyro: GyroTurns | None = None
    stabilisation: Stabilisation | None = None

    def moving(self, all_streams: bool = False) -> Generator[MovingFrame | SidePacket]:
        """Yields the frames with their motion; with ``all_streams``, also the packets of the other streams."""
        at_most = max(1, int(_AHEAD_BYTES / frame_bytes(self.clip)))
        frames = self.clip.items(self.options.start, self.options.end, all_streams)
        items = ahead(frames, min(_DECODED_AHEAD, at_most))
        if self.stabilisation is not None:
            return _steady(self.stabilisation, items)
        if self.unmoved is not None:
            return _without_motion(self.unmoved, items)
        if self.file_motion is not None:
            return _with_file_motion(self.file_motion, items)
        together = window(self.clip)
        focal_px = self.options.shutter.focal_px
        if focal_px is None and self.gyro is not None:
            focal_px = self.gyro.focal_px(self.readout.frame_size(self.clip.height, self.clip.width)[0])
        camera = CameraMotion(
            self.ratio,
            focal_px,
            self.readout,
            window=together,
            fewest=FEWEST,
            turns=self.gyro,
            whole_path=self.options.steadiness.stabilize is not None or self.options.save_motion is not None,
        )
        return ahead(with_motion(self.clip, items, camera), min(_MOVING_AHEAD, at_most))  # as the next are analysed

    def rectified(self, warper: Warper, all_streams: bool = False) -> Generator[NewFrame | SidePacket]:
        """Yields the frames to encode; with ``all_streams``, also the packets of the other streams."""
        undo = self.options.undo
        items: Generator[MovingFrame | LinkedFrame | SidePacket] = self.moving(all_streams)
        if undo.model == "dense" and undo.strength and self.unmoved is None:
            borrow = undo.edges == "borrow"
            items = ahead(linked(self.clip, items, self.ratio.value, self.readout, borrow), _LINKED_AHEAD)
        return side_by_side(warper, items, thread_count())


def _without_motion(reason: Reason, items: Iterable[VideoFrame | SidePacket]) -> Generator[MovingFrame | SidePacket]:
    motion = RowMotion.zero(ROWS, ROWS, reason=reason)
    for item in items:
        yield item if isinstance(item, SidePacket) else MovingFrame(item, motion)


def _with_file_motion(
    motion: ClipMotion, items: Iterable[VideoFrame | SidePacket]
) -> Generator[MovingFrame | SidePacket]:
    for item in items:
        if isinstance(item, SidePacket):
            yield item
        else:
            its_motion, cut, step = motion.at(item.time or 0.0)
            yield MovingFrame(item, its_motion, cut=cut, step=step)


def _steady(
    stabilisation: Stabilisation, items: Iterable[VideoFrame | SidePacket]
) -> Generator[MovingFrame | SidePacket]:
    path, frame = stabilisation.path, 0
    for item in items:
        if isinstance(item, SidePacket):
            yield item
        else:
            known = path.motion(frame), path.cuts[frame]
            yield MovingFrame(item, *known, step=path.step(frame), view=stabilisation.view(frame))
            frame += 1


# ---- threads ---------------------------------------------------------------------------------------------


def ahead(items: Iterable[_T], most: int) -> Generator[_T]:
    """Yields the items, computed by a separate thread up to ``most`` ahead; re-raises its errors.

    When the iterator is closed, the thread ends after its current item and closes its own source.
    """
    waiting: Queue[Any] = Queue(most)
    stopped = threading.Event()
    thread = threading.Thread(target=_work, args=(iter(items), waiting, stopped), daemon=True)
    thread.start()
    try:
        while True:
            item, error = waiting.get()
            if error is not None:
                raise error
            if item is _END:
                return
            yield item
    finally:
        stopped.set()
        while thread.is_alive():
            with suppress(Empty):
                waiting.get_nowait()
            thread.join(_ASK_S)


def _work(source: Iterator[Any], waiting: Queue[Any], stopped: threading.Event) -> None:
    """Puts items into a queue, followed by an end marker or an error."""

    def put(item: Any, error: BaseException | None) -> bool:
        while not stopped.is_set():
            with suppress(Full):
                waiting.put((item, error), timeout=_ASK_S)
                return True
        return False

    try:
        for item in source:
            if not put(item, None):
                break
        put(_END, None)
    except BaseException as error:  # re-raised by the consumer, whatever it is
        put(_END, error)
    finally:
        if isinstance(source, Generator):
            source.close()


def side_by_side(function: Callable[[_T], _U], items: Iterable[_T], threads: int) -> Generator[_U]:
    """Yields ``function`` of each item, in order, computing several in parallel."""
    running: deque[Future[_U]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for item in items:
                running.append(pool.submit(function, item))
                if len(running) > threads:
                    yield running.popleft().result()
            while running:
                yield running.popleft().result()
        finally:
            for future in running:
                future.cancel()
