"""Draws the pictures of docs/tutorial/symptoms.md and gallery.md: ``python docs/figures/draw_symptoms.py``.

All show places of the laboratory (Poly Haven, CC0), photographed by its renderer; the motion of each row is known.
"""

from pathlib import Path

import cv2
import numpy as np

import unshutter
from unshutter.motion.edges import valid_window
from unshutter.photo import Photo
from unshutter_lab.evaluation.metrics import epe_of_nothing, motion_error
from unshutter_lab.evaluation.place_cases import SUITES, PlaceCase
from unshutter_lab.synthesis.panorama import Camera, Place, shipped_places
from unshutter_lab.synthesis.place_photos import Rotating, take_photo
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera

HERE = Path(__file__).parent
SIZE = 384, 512  # rows and columns of a photo [px]
TILE = 288, 384  # of a picture in the docs
GAP, QUALITY = 8, 82
PLACES = shipped_places()
READOUT_S = 0.05


def camera_at(yaw: float, tilt: float = 0.0, roll: float = 0.0, view_deg: float = 60.0) -> Camera:
    """A camera of the photos' size, all angles in degrees."""
    return Camera.of_view(*SIZE, view_deg, yaw=yaw, tilt=tilt, roll=roll)


def seen(place: str, camera: Camera) -> np.ndarray:
    """A place by a camera that stands still, [H, W, 3]."""
    return Place.load(PLACES[place]).seen(camera)


def turned(
    place: str, camera: Camera, rates: tuple[float, float], hertz: float = 0.0, exposed_rows: float = 0.0
) -> np.ndarray:
    """A place by a camera that turns to the left and rolls [degrees/s], evenly or or swinging."""
    times = np.arange(-0.2, 0.4, 0.001)
    wave = np.cos(2 * np.pi * hertz * times)
    log = RotationLog(times, *(np.radians(rate) * wave for rate in rates), np.zeros_like(times))
    return take_photo(Place.load(PLACES[place]), camera, Rotating(camera, log, READOUT_S), exposed_rows)


def undone(before: np.ndarray, **options: object) -> tuple[np.ndarray, np.ndarray]:
    """A photo and what unshutter makes of it, both in the frame of the crop."""
    result = unshutter.rectify(before, edges="keep", **options)
    print(options, result.changed, result.reason, round(result.verdict.largest_px))
    window = valid_window(result.valid, any_shape=True)
    rows, cols = slice(window.top, window.bottom), slice(window.left, window.right)
    return before[rows, cols], result.array[rows, cols]


def show(name: str, *pictures: np.ndarray, tile: tuple[int, int] = TILE) -> None:
    """Saves pictures side by side, each as large as the others."""
    gap = np.full((tile[0], GAP, 3), 255, np.uint8)
    parts = [part for picture in pictures for part in (gap, filling(picture, tile))][1:]
    save(name, np.hstack(parts))


def filling(picture: np.ndarray, tile: tuple[int, int]) -> np.ndarray:
    """A picture at the size of a tile; what its shape has too much is cut off on both sides."""
    height, width = picture.shape[:2]
    scale = max(tile[0] / height, tile[1] / width)
    rows, cols = (round(side / scale) for side in tile)
    top, left = (height - rows) // 2, (width - cols) // 2
    part = picture[max(top, 0) : max(top, 0) + rows, max(left, 0) : max(left, 0) + cols]
    return cv2.resize(part, tile[::-1], interpolation=cv2.INTER_AREA)


def save(name: str, pixels: np.ndarray) -> None:
    """Saves pixels [H, W, 3] as a JPEG."""
    Photo.from_array(np.ascontiguousarray(pixels)).image.jpegsave(
        str(HERE / f"{name}.jpg"), Q=QUALITY, optimize_coding=True
    )


def lean_and_bend() -> None:
    """A pan, which makes houses lean, and a camera that turns unevenly, which bends them."""
    show("symptom_leans", *undone(turned("san_giuseppe_bridge", camera_at(65), (-115, 0))))
    show("symptom_bends", *undone(turned("leadenhall_market", camera_at(240), (150, -60), hertz=9)))


def wobble() -> None:
    """The middle one of three frames of a camera that is shaken fast, by itself and with the frames beside it."""
    camera, times = camera_at(62, tilt=4), np.arange(-0.1, 0.3, 0.001)
    rates = [np.radians(rate) * np.cos(2 * np.pi * hertz * times) for rate, hertz in ((170, 14), (60, 11), (20, 7))]
    size = {"height": SIZE[0], "width": SIZE[1], "focal_px": camera.focal_px}
    moving = RotatingCamera(RotationLog(times, *rates), 0.0, 3, 30.0, 0.8, **size)
    place = Place.load(PLACES["schadowplatz"])
    rotations = (moving.rotations(moving.row_times(frame)) for frame in range(3))
    frames = [place.seen(camera, each.transpose(0, 2, 1)) for each in rotations]
    results = list(unshutter.rectify_frames(frames, readout_ratio=0.8, edges="keep", reference="middle"))
    window = valid_window(results[1].valid, any_shape=True)
    rows, cols = slice(window.top, window.bottom), slice(window.left, window.right)
    show("symptom_wobbles", frames[1][rows, cols], results[1].array[rows, cols])


def perspective() -> None:
    """A photo by a camera that looks up: no rolling shutter, but undone if asked for."""
    show("symptom_narrows", *undone(seen("neuer_zollhof", camera_at(140, tilt=16)), upright="full"))


def stripes() -> None:
    """A room under lamps that flicker 100 times a second, which show as bands: each row has its own brightness."""
    room = seen("st_fagans_interior", camera_at(200)).astype(float)
    times = np.arange(SIZE[0]) / SIZE[0] * READOUT_S
    light = 0.75 + 0.25 * np.cos(2 * np.pi * 100 * times)
    show("symptom_stripes", (room * light[:, None, None]).astype(np.uint8), room.astype(np.uint8))


def stretched() -> None:
    """A bus that drives past a camera that stands still: drawn row by row, each at its own moment."""
    street = seen("potsdamer_platz", camera_at(20))
    pictures = []
    for readout_px in (130, 0):  # that the bus moves while the photo is read
        picture = street.copy()
        for row in range(SIZE[0]):
            layer = bus(street, round(readout_px * (row / SIZE[0] - 0.65)))
            picture[row] = layer[row]
        pictures.append(picture)
    show("symptom_stretched", *pictures)


def bus(street: np.ndarray, right: int) -> np.ndarray:
    """A drawn bus in front of a street, so many pixels to the right."""
    picture, left = street.copy(), 90 + right
    cv2.rectangle(picture, (left, 175), (left + 300, 282), (196, 52, 40), -1, cv2.LINE_AA)
    for k in range(6):
        cv2.rectangle(picture, (left + 14 + 47 * k, 190), (left + 50 + 47 * k, 232), (208, 222, 230), -1, cv2.LINE_AA)
    for across in (60, 240):
        cv2.circle(picture, (left + across, 282), 23, (30, 32, 35), -1, cv2.LINE_AA)
        cv2.circle(picture, (left + across, 282), 10, (150, 152, 155), -1, cv2.LINE_AA)
    return picture


def blurred_and_bulging() -> None:
    """What other programs undo: blur, and a lens that bulges."""
    blurred = turned("hamburg_hbf", camera_at(240), (60, 0), exposed_rows=120)
    sharp = seen("leadenhall_market", camera_at(180, view_deg=85))
    matrix = np.array([[300.0, 0, SIZE[1] / 2], [0, 300.0, SIZE[0] / 2], [0, 0, 1]])
    across, down = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    points = np.stack([across, down], -1).reshape(-1, 1, 2).astype(np.float64)
    found = cv2.undistortPoints(points, matrix, np.array([-0.25, 0.04, 0, 0]), P=matrix).reshape(*SIZE, 2)
    bulging = cv2.remap(sharp, *np.moveaxis(found.astype(np.float32), -1, 0), cv2.INTER_LINEAR)
    show("symptom_others", blurred, bulging[48:-48, 56:-56])


def gallery() -> None:
    """Photos of all places in three suites: the best results, the largest motions that were left, the worst results.

    Each is shown as it was taken, as unshutter leaves it, and as it should be.
    """
    shown: list[tuple[float, float, bool, str, np.ndarray]] = []
    for suite in (suite for suite in SUITES if suite.name in ("pan 50 ms", "quadratic", "hand 100 ms")):
        for path in PLACES.values():
            case = PlaceCase(suite, "places", path, 0, 0)
            exam = case.exam()
            before = exam.view.photo.to_array()
            result = unshutter.rectify(exam.view.photo, edges="keep", focal_px=exam.view.camera.focal_px)
            error, moved = motion_error(result.motion, exam.truth).epe, epe_of_nothing(exam.truth)
            after = filling(result.array, before.shape[:2])
            triple = [filling(each, (216, 288)) for each in (before, after, exam.gs)]
            shown.append((moved, error, result.changed, f"{case.title}", np.hstack(triple)))
    changed, left = ([each for each in shown if each[2] is there] for there in (True, False))
    sheets = {
        "best": sorted(changed, key=lambda each: each[1] - each[0])[:4],
        "left": sorted(left, key=lambda each: -each[0])[:3],
        "worst": sorted(changed, key=lambda each: each[0] - each[1])[:3],
    }
    print(len(shown), "photos,", len(changed), "changed, better:", sum(each[1] < each[0] for each in changed))
    for name, chosen in sheets.items():
        for moved, error, _, title, _ in chosen:
            print(f"{name}: {title}: {moved:.1f} -> {error:.1f} px")
        save(
            f"gallery_{name}",
            np.vstack([np.pad(each[-1], ((0, GAP), (0, 0), (0, 0)), constant_values=255) for each in chosen]),
        )


if __name__ == "__main__":
    lean_and_bend()
    wobble()
    perspective()
    stripes()
    stretched()
    blurred_and_bulging()
    gallery()
