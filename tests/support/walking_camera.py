"""Points in space seen by a camera that walks and swings while each picture is read, and its COLMAP model; exact."""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from unshutter.motion import RotationMotion
from unshutter.orientation import ScanDirection

HEIGHT, WIDTH, FOCAL = 480, 640, 500.0
FPS, RATIO = 30.0, 0.6
CENTRE = np.array([WIDTH / 2, HEIGHT / 2])  # COLMAP's: the centre of the first pixel is at (0.5, 0.5)


@dataclass(frozen=True)
class WalkingCamera:
    """A camera whose sensor is read in 20 ms, with pictures of 640x480 px; every third frame is in the model.

    Attributes:
        numbers: the frames in the model.
        speed: how fast it walks [m/s].
        swing: how far it turns to each side [rad], four times a second.
        apparent: [3] rate that its motion files turn too fast, as tracks of a walking camera do [rad/s].
        readout: direction in which the pictures were read.
    """

    numbers: tuple[int, ...] = (0, 3, 6, 9, 12)
    speed: float = 1.0
    swing: float = 0.08
    apparent: tuple[float, float, float] = (0.0, 0.0, 0.0)
    readout: ScanDirection = ScanDirection.TOP_TO_BOTTOM

    def rotation(self, time_s: float) -> np.ndarray:
        """[3, 3] from the world to the camera."""
        angle = 2 * np.pi * 4 * time_s
        turn = self.swing * np.array([np.sin(angle), np.cos(1.3 * angle), 0.5 * np.sin(0.7 * angle + 1)])
        return cv2.Rodrigues(turn)[0]

    def position(self, time_s: float) -> np.ndarray:
        """[3] in the world [m]."""
        return self.speed * np.array([time_s, 0.02 * np.sin(2 * np.pi * time_s), 0.3 * time_s])

    def time_s(self, number: int, line: float) -> float:
        """When a line of a frame is read, counted in the order of reading."""
        lines = WIDTH if self.readout.sideways else HEIGHT
        return number / FPS + RATIO / FPS * line / lines

    def line_of(self, col: float, row: float) -> float:
        """The line, in the order of reading, that has a position; pixel centres are at whole numbers."""
        return {
            ScanDirection.TOP_TO_BOTTOM: row,
            ScanDirection.BOTTOM_TO_TOP: HEIGHT - 1 - row,
            ScanDirection.LEFT_TO_RIGHT: col,
            ScanDirection.RIGHT_TO_LEFT: WIDTH - 1 - col,
        }[self.readout]

    def seen(self, number: int, point: np.ndarray) -> np.ndarray:
        """(col, row) at which a frame shows a point: on the line that is read when it is there."""
        line = 0.0
        at = np.zeros(2)
        for _ in range(60):
            time_s = self.time_s(number, line)
            at = project(self.rotation(time_s), self.position(time_s), point)
            before, line = line, self.line_of(*at)
            if abs(line - before) < 1e-9:
                break
        return at

    def write_model(self, folder: Path, binary: bool = False, share: float = 0.5) -> Path:
        """Writes a model with the pose of the middle line of each picture, or that of another share."""
        folder.mkdir(parents=True)
        lines = WIDTH if self.readout.sideways else HEIGHT
        poses = [self._pose(self.time_s(number, share * (lines - 1))) for number in self.numbers]
        parameters = (FOCAL, FOCAL, *CENTRE)
        if not binary:
            camera = " ".join(map(repr, map(float, parameters)))
            (folder / "cameras.txt").write_text(f"# a remark\n7 PINHOLE {WIDTH} {HEIGHT} {camera}\n")
            text = "# a remark\n"
            for k, (number, pose) in enumerate(zip(self.numbers, poses, strict=True)):
                points = "12.5 30 -1 4 5 77" if k % 2 else ""  # none: an empty line
                text += f"{k + 1} {' '.join(map(repr, map(float, pose)))} 7 {number:05}.png\n{points}\n"
            (folder / "images.txt").write_text(text)
            return folder
        data = struct.pack("<QIiQQ4d", 1, 7, 1, WIDTH, HEIGHT, *parameters)
        (folder / "cameras.bin").write_bytes(data)
        data = struct.pack("<Q", len(poses))
        for k, (number, pose) in enumerate(zip(self.numbers, poses, strict=True)):
            data += struct.pack("<I7dI", k + 1, *pose, 7) + f"{number:05}.png\0".encode()
            data += struct.pack("<Q", k) + struct.pack("<ddQ", 1.0, 2.0, 3) * k
        (folder / "images.bin").write_bytes(data)
        return folder

    def _pose(self, time_s: float) -> np.ndarray:
        rotation = self.rotation(time_s)
        turn = cv2.Rodrigues(rotation)[0].ravel()
        angle = np.linalg.norm(turn)
        quaternion = [np.cos(angle / 2), *(np.sin(angle / 2) * turn / angle)]
        return np.array([*quaternion, *(-rotation @ self.position(time_s))])

    def turns(self, number: int, lines: np.ndarray, of: int) -> np.ndarray:
        """[N, 3] rotation vectors since the first of ``of`` lines, in the readout frame, as motion files have them."""
        turned = self._to_frame()
        whole = WIDTH if self.readout.sideways else HEIGHT
        times = [self.time_s(number, (line + 0.5) * whole / of - 0.5) for line in lines]
        first = self.rotation(times[0])
        return np.array([turned @ self._tracked(self.rotation(t) @ first.T, t - times[0]) for t in times])

    def _to_frame(self) -> np.ndarray:
        quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        return np.linalg.matrix_power(quarter, self.readout.quarter_turns)

    def _tracked(self, rotation: np.ndarray, seconds: float) -> np.ndarray:
        excess = cv2.Rodrigues(seconds * np.array(self.apparent))[0]
        return cv2.Rodrigues(excess @ rotation)[0].ravel()

    def write_motions(self, folder: Path) -> Path:
        """Writes the motion file of each picture."""
        folder.mkdir()
        lines, across = self.readout.frame_size(HEIGHT, WIDTH)
        for number in self.numbers:
            turns = self.turns(number, np.arange(lines), lines)
            RotationMotion(across, turns, FOCAL, scan_direction=self.readout).save(folder / f"{number:05}.json")
        return folder

    def write_clip_motion(self, file: Path, frames: int) -> Path:
        """Writes the motion file of the whole video."""
        small, saved = 65, 17
        middle = (small - 1) / 2
        lines, _ = self.readout.frame_size(HEIGHT, WIDTH)
        records = []
        for number in range(frames):
            turns = self.turns(number, np.linspace(0, small - 1, saved), small)
            record = {"time_s": number / FPS, "cut": False, "focal": FOCAL / lines, "rotations_rad": turns.tolist()}
            if number:
                before, now = (self.time_s(k, (middle + 0.5) * lines / small - 0.5) for k in (number - 1, number))
                turn = self._to_frame() @ self._tracked(self.rotation(now) @ self.rotation(before).T, now - before)
                record["step"] = {"turn_rad": turn.tolist(), "focal": FOCAL / lines}
            records.append(record)
        head = {"format": "unshutter-clip-motion/1", "height": HEIGHT, "width": WIDTH, "readout": str(self.readout)}
        file.write_text(json.dumps({**head, "readout_ratio": RATIO, "frames": records}))
        return file


def project(rotation: np.ndarray, position: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(col, row) of a point; pixel centres are at whole numbers."""
    x, y, z = rotation @ (point - position)
    return np.array([x / z, y / z]) * FOCAL + CENTRE - 0.5


def points(count: int = 40, seed: int = 3) -> np.ndarray:
    """[N, 3] points in front of the camera, 3 to 8 m away [m]."""
    random = np.random.default_rng(seed)
    far = random.uniform(3, 8, count)
    return np.stack([random.uniform(-0.45, 0.45, count) * far, random.uniform(-0.35, 0.35, count) * far, far], axis=-1)
