"""What a run must not write to: the files that it reads, and whatever a link leads to."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path

from unshutter.errors import UnshutterError
from unshutter.storage.places import Place, file_below, object_behind, way


class Protection:
    """Keeps a run from writing to its own inputs, whatever names and links lead to them.

    The one rule for all writers of all commands. Two names are of one file when they have the same device and inode
    (which capitals and links do not change), or the same real path where a file system has no inodes; URLs are followed
    to the file or object that they end in. The inputs are looked at when a file is in the way of a result, not before.

    Args:
        inputs: files that the run reads; of a folder, those in it that it reads.
        folders: that the user named for results: links below them are not followed. (Those above are the user's way
            of naming them.)
    """

    def __init__(self, inputs: Iterable[Place | None], folders: Iterable[Place | None] = ()):
        self._inputs = [place for place in inputs if place is not None]
        self._folders = [place for place in folders if place is not None]
        self._looked_at: set[Place] = set()  # folders behind no link

    def check(self, target: Place | None) -> None:
        """Checks a place before something is written there.

        Raises:
            UnshutterError: it is an input, or lies behind a link.
        """
        if target is None:
            return
        if self._is_input(target):
            raise UnshutterError(
                f"{target} is an original (an input of this run), which is never overwritten: choose another name"
            )
        self.check_folder(target.parent)

    def check_all_in(self, folder: Path) -> None:
        """Checks a folder that gets files of whatever names: none of the files in it is an input.

        Raises:
            UnshutterError: one is.
        """
        with suppress(OSError):  # there is no folder yet
            for name in sorted(os.listdir(folder)):
                if self._is_input(folder / name):
                    raise UnshutterError(
                        f"{folder / name} is an input of this run: choose another folder for its results"
                    )

    def check_folder(self, folder: Place) -> None:
        """Checks a folder before it is made, or something is written there.

        Raises:
            UnshutterError: it lies behind a link.
        """
        if folder in self._looked_at:
            return
        for named in self._folders:
            inside = way(named, folder)
            if inside is None or not isinstance(named, Path):
                continue
            for part in [inside, *inside.parents][:-1]:
                if os.path.islink(named / part):
                    reason = f"{named / part} is a link, and nothing is written through links"
                    raise UnshutterError(f"cannot write to {folder}: {reason}")
        self._looked_at.add(folder)

    def _is_input(self, target: Place) -> bool:
        if not isinstance(target, Path):
            archive = file_below(str(target))
            return object_behind(target) in self._objects or (archive is not None and self._is_input(archive))
        if not os.path.lexists(target):
            return False
        with suppress(OSError):
            status = target.stat()
            if (status.st_dev, status.st_ino) in self._inodes:
                return True
        names = (os.path.realpath(target), os.path.abspath(target))
        return any(os.path.normcase(name) in self._real_paths for name in names)

    @cached_property
    def _files(self) -> list[Path]:
        """The inputs of this machine, and the archives that inputs lie in."""
        files = [place if isinstance(place, Path) else file_below(str(place)) for place in self._inputs]
        return [file for file in files if file is not None]

    @cached_property
    def _objects(self) -> set[tuple[str, str]]:
        return {object_behind(place) for place in self._inputs if not isinstance(place, Path)}

    @cached_property
    def _inodes(self) -> set[tuple[int, int]]:
        inodes = set()
        for file in self._files:
            with suppress(OSError):
                if (status := file.stat()).st_ino:
                    inodes.add((status.st_dev, status.st_ino))
        return inodes

    @cached_property
    def _real_paths(self) -> set[str]:
        """Of the inputs, and of the links that some of them are."""
        real_folder = cache(os.path.realpath)  # most lie in a few folders
        paths = set()
        for file in self._files:
            path = os.path.join(real_folder(file.parent), file.name)
            paths |= {path, os.path.realpath(path)} if os.path.islink(path) else {path}
        return {os.path.normcase(path) for path in paths}
