"""From a film to poses: with the motion that unshutter finds in the frames, and the true pose of their middle rows."""

from pathlib import Path

import cv2
import numpy as np

import unshutter
from support import clips
from unshutter.cli import main
from unshutter_lab.synthesis.sequences import TurningCamera

FRAMES = range(3, 21, 3)
CENTRE = np.array([(clips.WIDTH - 1) / 2, (clips.HEIGHT - 1) / 2])


def write_model(camera: TurningCamera, folder: Path) -> Path:
    folder.mkdir()
    numbers = f"{clips.WIDTH} {clips.HEIGHT} {clips.FOCAL} {clips.WIDTH / 2} {clips.HEIGHT / 2}"
    (folder / "cameras.txt").write_text(f"1 SIMPLE_PINHOLE {numbers}\n")
    lines: list[str] = []
    for frame in FRAMES:
        turn = cv2.Rodrigues(true_rotation(camera, frame, clips.HEIGHT // 2))[0].ravel()
        angle = float(np.linalg.norm(turn))
        quaternion = [np.cos(angle / 2), *(np.sin(angle / 2) * turn / angle)]
        lines += [f"{frame + 1} {' '.join(map(str, quaternion))} 0 0 0 1 {frame:05}.png", ""]
    (folder / "images.txt").write_text("\n".join(lines))
    return folder


def true_rotation(camera: TurningCamera, frame: int, row: float) -> np.ndarray:
    """From the world to the camera."""
    return camera.rotations(np.array([frame + clips.RATIO * (row + 0.5) / clips.HEIGHT]))[0]


def project(rotation: np.ndarray, direction: np.ndarray) -> np.ndarray:
    x, y, z = rotation @ direction
    return np.array([x / z, y / z]) * clips.FOCAL + CENTRE


def errors_px(camera: TurningCamera, poses: unshutter.CameraPoses, by_row: bool) -> np.ndarray:
    """How far from its place each direction of a grid is projected, in all pictures [px]."""
    across, down = np.meshgrid(np.linspace(-0.5, 0.5, 7), np.linspace(-0.4, 0.4, 7))
    found: list[float] = []
    for each in poses.pictures:
        frame = int(each.picture.name[:5])
        for direction in np.stack([across, down, np.ones_like(down)], axis=-1).reshape(-1, 3):
            row = clips.HEIGHT / 2
            for _ in range(50):
                seen = project(true_rotation(camera, frame, row), direction)
                row = seen[1]
            if 0 <= row <= clips.HEIGHT - 1:
                pose = each.at(row / (clips.HEIGHT - 1) if by_row else 0.5)
                found.append(float(np.hypot(*(project(pose[:3, :3], direction) - seen))))
    return np.array(found)


def test_the_motion_found_in_a_film_gives_the_poses_of_its_rows(tmp_path: Path) -> None:
    camera, frames = clips.moving(24)
    film = clips.write(tmp_path / "film.mp4", frames, "libx264", options={"crf": "12"})
    motions = tmp_path / "film.json"
    words = ["video", str(film), *clips.KNOWN, "-o", str(tmp_path / "straight.mp4"), "--save-motion", str(motions)]
    assert main(words) == 0
    poses = unshutter.camera_poses(write_model(camera, tmp_path / "sparse"), motions, rows=clips.HEIGHT)
    assert len(poses.pictures) == len(FRAMES)
    by_row, alone = (errors_px(camera, poses, each) for each in (True, False))
    assert np.sqrt(np.mean(by_row**2)) < 0.1 * np.sqrt(np.mean(alone**2))
