"""All options for rectifying a photo."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from unshutter.errors import UsageError
from unshutter.options.camera import Camera, Find
from unshutter.options.neighbours import Clock, Neighbours, model_for
from unshutter.options.picture import Save, Undo

_FIND, _UNDO, _SAVE, _NEIGHBOURS = Find(), Undo(), Save(), Neighbours()


@dataclass(frozen=True)
class Rectify:
    """What is done to a photo: its motion found or given, undone, and the picture written. :meth:`of` makes one.

    Attributes:
        find: how the motion is found.
        motion: motion file to undo; None: the motion is found.
        undo: how the motion is undone.
        save: how the picture is written.
        neighbours: frames before and after that show how the camera moved; without them, only the photo is used.

    Raises:
        UsageError: a motion is combined with focal length, roll, tilt or least confidence, used to find one; or
            neighbours with options that do not apply to them.
    """

    find: Find = field(default_factory=Find)
    motion: Path | None = None
    undo: Undo = field(default_factory=Undo)
    save: Save = field(default_factory=Save)
    neighbours: Neighbours = field(default_factory=Neighbours)

    @classmethod
    def of(
        cls,
        find: Find = _FIND,
        motion: Path | None = None,
        undo: Undo = _UNDO,
        save: Save = _SAVE,
        neighbours: Neighbours = _NEIGHBOURS,
    ) -> Rectify:
        """Combines the user's options and applies their consequences.

        A given motion is undone regardless of its confidence, results of a sequence keep their coordinates, and a least
        confidence of 0 accepts the likeliest motion.

        Args:
            find, motion, undo, save, neighbours: the user's options.

        Raises:
            UsageError: some options exclude each other.
        """
        asked = cls(find, motion, undo, save, neighbours)
        if motion is not None:
            undo = undo.at_any_confidence()
        if neighbours.sequence:
            undo = undo.keeping_coordinates()
        if asked.find_alone is not None or neighbours.fallback:
            find = replace(find, camera=find.camera.for_least_confidence(undo.min_confidence))
        return replace(asked, find=find, undo=undo)

    def __post_init__(self) -> None:
        if self.motion is not None:
            self.find.camera.check_unused()
        if self.neighbours or self.neighbours.sequence:
            self._check_neighbours()
        elif self.undo.edges == "borrow":
            raise UsageError("--edges borrow needs a neighbour: name one with --before or --after")

    def _check_neighbours(self) -> None:
        camera, neighbours = self.find.camera, self.neighbours
        if self.motion is not None:
            raise UsageError("--before, --after and --sequence are for finding a motion: leave out --motion")
        if (
            replace(camera, readout_ms=None, focal_px=None, no_film=False) != Camera(camera.readout)
            and not neighbours.fallback
        ):
            raise UsageError("roll, tilt, exposure and --moving are for single photos: leave them out")
        if neighbours.at is not None and self.undo.reference is not None:
            raise UsageError("--at and --reference both set the moment of the picture: choose one")
        if (camera.readout_ms is None) != (neighbours.clock.fps is None) and not neighbours.fallback:
            raise UsageError("--readout-ms and --fps go together: what counts is their product")
        _ = self.clock  # raises for impossible numbers
        model_for(neighbours.model, neighbours.at, self.undo)

    @property
    def clock(self) -> Clock:
        """Timing of the neighbouring frames."""
        return replace(self.neighbours.clock, readout_ms=self.find.camera.readout_ms)

    @property
    def find_alone(self) -> Find | None:
        """Options for finding the motion from each photo alone; None if it is not found that way."""
        return None if self.motion is not None or self.neighbours or self.neighbours.sequence else self.find
