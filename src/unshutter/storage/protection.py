"""Protects the files that a run reads, and the targets of links, from being written to."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path

from unshutter.errors import UnshutterError
from unshutter.storage.places import Place, file_below, object_behind, way


class Protection:
    """Prevents a run from writing to its own inputs, under any name and through any link.

    All writers of all commands use this rule. Two names refer to the same file if they have the same device and inode
    (independent of case and links), or the same real path on file systems without inodes; URLs are resolved to the file
    or object that they lead to. Inputs are examined only when a result's name exists.

    Args:
        inputs: files that the run reads; for a folder, the files in it that the run reads.
        folders: output folders named by the user: links below them are not followed. (Links above them are part of the
            name that the user chose.)
    """

    def __init__(self, inputs: Iterable[Place | None], folders: Iterable[Place | None] = ()):
        self._inputs = [place for place in inputs if place is not None]
        self._folders = [place for place in folders if place is not None]
        self._looked_at: set[Place] = set()  # folders without links in their paths

    def check(self, target: Place | None) -> None:
        """Checks a place before it is written.

        Raises:
            UnshutterError: it is an input, or behind a link.
        """
        if target is None:
            return
        if self._is_input(target):
            raise UnshutterError(
                f"{target} is an original (an input of this run), which is never overwritten: choose another name"
            )
        self.check_folder(target.parent)

    def check_all_in(self, folder: Path) -> None:
        """Checks that a folder that will receive files of arbitrary names contains no input.

        Raises:
            UnshutterError: it contains one.
        """
        with suppress(OSError):  # the folder does not exist yet
            for name in sorted(os.listdir(folder)):
                if self._is_input(folder / name):
                    raise UnshutterError(
                        f"{folder / name} is an input of this run: choose another folder for its results"
                    )

    def check_folder(self, folder: Place) -> None:
        """Checks a folder before it is created or written to.

        Raises:
            UnshutterError: it is behind a link.
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
        """The inputs on this machine, and the archives that contain inputs."""
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
        """Real paths of the inputs, and the paths of those that are links."""
        real_folder = cache(os.path.realpath)  # cached: most files share a few folders
        paths = set()
        for file in self._files:
            path = os.path.join(real_folder(file.parent), file.name)
            paths |= {path, os.path.realpath(path)} if os.path.islink(path) else {path}
        return {os.path.normcase(path) for path in paths}
