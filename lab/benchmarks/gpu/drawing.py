"""Corners and towns drawn on all processors while the network learns from those drawn before."""

from __future__ import annotations

import multiprocessing
import os
import queue
from typing import Any

import cv2
from torch import Tensor

from unshutter_lab.synthesis.panorama import Place
from unshutter_lab.training.facades import draw_facades
from unshutter_lab.training.pixels import PixelData
from unshutter_lab.training.towns import draw_place

_SEED = 2**24  # of what is drawn here; below are those of the configurations
_TOWNS = 4  # every fourth is a town
_CORNERS = 300, 8000  # held at the start, and at most
_PLACES = 64  # towns held
_AHEAD = 60  # pictures that a process may be ahead
_PATIENCE_S = 120.0  # for one picture: if none comes, the processes have ended
_AT_A_TIME = 2  # taken before a step: each of them costs time in which nothing is learned


class Drawing:
    """Processes that draw, each with seeds of its own."""

    def __init__(self, canvas: int, side: int):
        count = max((os.cpu_count() or 2) - 1, 1)
        context = multiprocessing.get_context("spawn")
        self._drawn: Any = context.Queue(_AHEAD * count)
        self._corners: list[Tensor] = []
        self._towns: list[Place] = []
        self.count = 0
        self._workers = [
            context.Process(target=_draw, args=(self._drawn, canvas, side, first, count), daemon=True)
            for first in range(count)
        ]
        for worker in self._workers:
            worker.start()

    def fill(self, data: PixelData) -> None:
        """Copies what was drawn for the previous network, and waits until there is enough to begin."""
        data.drawn = self._corners
        if data.places is not None:
            data.places.drawn = self._towns
        while len(self._corners) < _CORNERS[0] or len(self._towns) < _PLACES:
            drawn = self._drawn.get(timeout=_PATIENCE_S)
            if isinstance(drawn, Place):
                self._towns.append(drawn)
            else:
                self._corners.append(data.held(drawn))

    def renew(self, data: PixelData) -> None:
        """Adds some of what was drawn since; once there are many corners, each new one replaces another."""
        for _ in range(_AT_A_TIME):
            try:
                drawn = self._drawn.get_nowait()
            except queue.Empty:
                return
            self.count += 1
            if isinstance(drawn, Place):
                if data.places is not None:
                    data.places.draw_anew(self.count % len(data.places.drawn), drawn)
            elif len(data.drawn) < _CORNERS[1]:
                data.drawn.append(data.held(drawn))
            else:
                data.drawn[self.count % _CORNERS[1]] = data.held(drawn)

    def stop(self) -> None:
        """Ends the processes."""
        for worker in self._workers:
            worker.terminate()


def _draw(drawn: Any, canvas: int, side: int, first: int, step: int) -> None:
    cv2.setNumThreads(1)
    seed = _SEED + first
    while True:
        is_town = (seed // step) % _TOWNS == 0
        drawn.put(Place(draw_place(side, seed)) if is_town else draw_facades(canvas, seed))
        seed += step
