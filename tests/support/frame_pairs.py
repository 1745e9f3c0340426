"""Frames of a moving scene as a rolling shutter takes them, and as a global one would have."""

import cv2
import numpy as np

from support.drawn_photos import textured

HEIGHT, WIDTH = 160, 240
MARGIN = 80  # px of the scene around the first frame


class Scene:
    """A textured wall that moves, and before it, if wanted, a board that moves otherwise.

    Args:
        speed: of the wall [px / frame interval], (columns, rows).
        gain: change of that speed in a frame interval.
        board_speed: of the board; None: there is none.
    """

    def __init__(self, speed=(18.0, 3.0), gain=(0.0, 0.0), board_speed=None, dtype=np.uint8):
        self.wall = textured(HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN, dtype=dtype)
        self.board = textured(90, 70, dtype=dtype)[::-1]
        self.speed, self.gain, self.board_speed = np.array(speed), np.array(gain), board_speed

    def frame(self, number, ratio):
        """As a rolling shutter took it: row y at number + ratio * y / HEIGHT."""
        return self._seen(number + ratio * np.arange(HEIGHT)[:, None] / HEIGHT)

    def at(self, moment):
        """As a global shutter would have taken it."""
        return self._seen(np.full((HEIGHT, 1), float(moment)))

    def _seen(self, time):
        col, row = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
        moved = [self.speed[k] * time + self.gain[k] * time**2 / 2 for k in (0, 1)]
        picture = sampled(self.wall, col + MARGIN - moved[0], row + MARGIN - moved[1])
        if self.board_speed is not None:
            on_board = col - 80 - self.board_speed[0] * time, row - 30 - self.board_speed[1] * time
            covers = (on_board[0] >= 0) & (on_board[0] <= 69) & (on_board[1] >= 0) & (on_board[1] <= 89)
            picture = np.where(covers[..., None], sampled(self.board, *on_board), picture)
        return picture


def sampled(picture, col, row):
    maps = (np.broadcast_to(a, (HEIGHT, WIDTH)).astype(np.float32) for a in (col, row))
    return cv2.remap(picture, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def off(picture, truth, mask=True):
    """Root mean square difference [8-bit grey levels] where a mask is true."""
    scale = 255 / np.iinfo(truth.dtype).max
    mask = np.broadcast_to(mask, truth.shape[:2])
    return float(np.sqrt(np.mean((picture[mask].astype(float) - truth[mask]) ** 2))) * scale
