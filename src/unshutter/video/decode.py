"""The frames of a clip: decoded ahead of their use, with the packets of other streams that lie between them."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

from unshutter.errors import UnshutterError
from unshutter.video import containers
from unshutter.video.clip import ClipFacts, interlaced
from unshutter.video.containers import FilmFile

if TYPE_CHECKING:
    from av import Packet, VideoFrame

_LARGE = 6_000_000  # px: such frames are decoded one at a time, to save memory; other steps take longer
DECODED_AHEAD = 2  # frames, if they are small


def frames_of(clip: ClipFacts, start: float | None = None, end: float | None = None) -> Generator[VideoFrame]:
    """Opens a clip and yields the frames between two times [s] in presentation order; None means no limit."""
    with clip.opened() as file:
        yield from decode(file, clip, start, end)


def decode(
    file: FilmFile, clip: ClipFacts, start: float | None, end: float | None, others: deque[Packet] | None = None
) -> Iterator[VideoFrame]:
    """Yields the frames of an open clip between two times [s] in presentation order; None means no limit.

    Args:
        others: receives the packets of the other streams between these times, as they are met.
    """
    film = file.film
    film.thread_type = "AUTO" if clip.height * clip.width < _LARGE else "SLICE"
    if start and start - clip.lead_s > clip.expected.start_s:
        file.container.seek(int((start - clip.lead_s) / film.time_base), stream=film)
    times = containers.Times(clip.timing)
    for packet in file.packets():
        if not file.is_of_film(packet):
            if others is not None and packet.dts is not None and _is_within(containers.time_of(packet), start, end):
                others.append(packet)
            continue
        for frame in containers.decode_packet(packet, file.path):
            times.set(frame)
            if _is_within(frame.time, start, end):
                yield _checked(frame, clip)
            elif others is None and end is not None and (frame.time or 0) >= end:
                return


def _is_within(at: float | None, start: float | None, end: float | None) -> bool:
    return at is None or ((start is None or at >= start - 1e-6) and (end is None or at < end))


def _checked(frame: VideoFrame, clip: ClipFacts) -> VideoFrame:
    if frame.is_corrupt:
        raise containers.damaged(clip.path, frame.time)
    if frame.interlaced_frame:
        raise interlaced(clip.path)
    if (frame.width, frame.height, frame.format.name) != (clip.width, clip.height, clip.pixels.name):
        raise UnshutterError(
            f"{{clip}}: its frames change in size or format at {frame.time or 0:.1f} s", clip=clip.path
        )
    return frame


# ---- ahead of their use --------------------------------------------------------------------------------------------

_T = TypeVar("_T")


def ahead(items: Iterable[_T], most: int) -> Generator[_T]:
    """Yields the items, computed by a separate thread up to ``most`` ahead; re-raises its errors.

    When the iterator is closed, the thread ends after its current item and closes its own source.
    """
    source = iter(items)
    waiting = deque[Future[list[_T]]]()
    one_at_a_time = Lock()  # a pool does not know a thread whose start was interrupted, and would not wait for it

    def take_next() -> list[_T]:
        """Takes the next item, in a list that is empty at the end."""
        with one_at_a_time:
            return list(islice(source, 1))

    def close() -> None:
        with one_at_a_time:
            if isinstance(source, Generator):
                source.close()

    with ThreadPoolExecutor(1) as thread:
        try:
            waiting.extend(thread.submit(take_next) for _ in range(most))
            while item := waiting.popleft().result():
                waiting.append(thread.submit(take_next))
                yield item[0]
        finally:
            for future in waiting:
                future.cancel()
            thread.submit(close)
