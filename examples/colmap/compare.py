"""What rolling shutter does to COLMAP, and what is left of it after unshutter: measured where truth is known.

    pip install '.[colmap]'
    python examples/colmap/compare.py -o colmap_out

draws a street corner, photographs it with a rolling shutter from an arc (scene.py), and reconstructs the same walk
from a folder for each kind of picture:

    global_shutter    what the best could be
    rolling_shutter   as the camera took them
    rectified         each by itself, with the motion that the default method finds
    known_attitude    the same, told the focal length and how the camera was held, as a gimbal would say it
    sequence          each with the frames that the camera took just before and after it, the readout ratio given
    ratio_found       the same, the readout ratio found from 60 frames of the camera
    dense             as near and far move, from the frame before and the frame after
    chosen            the camera's motion or the dense one, as the frames bear out
    true_motion       with the turning that was put in: what a perfect estimate would give
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from scene import Camera, Frame, Plane, draw_scene, photograph, walk

import unshutter
from unshutter.frames.sequence import CameraMotion
from unshutter.motion.rotations import rotation_matrix
from unshutter.options import DEFAULT_ESTIMATOR, Clock, FrameModel, Undo
from unshutter.orientation import ScanDirection
from unshutter.photo import Photo
from unshutter.rectification.sequences import SequenceOptions, rectify_between

RATIO = 0.9  # readout time / frame interval: 30 ms at 30 frames/s
_SENSOR_DEG = 0.3  # error of an accelerometer or gimbal
_SEARCHED = 60  # frames that the readout ratio is found from


@dataclass(frozen=True)
class Outcome:
    """What one reconstruction came to.

    Attributes:
        pictures: how many there were.
        registered: how many COLMAP found a place for.
        points: 3-D points.
        track: pictures per point, mean.
        reprojection_px: mean reprojection error [px].
        place_cm: root mean square distance of the registered cameras from their true places, after the similarity
            that aligns them best [cm]; None with fewer than three.
        direction_deg: median angle between true and found camera rotations, after the same [deg].
    """

    pictures: int
    registered: int
    points: int
    track: float
    reprojection_px: float
    place_cm: float | None
    direction_deg: float | None


@dataclass(frozen=True)
class Walk:
    """The pictures of a walk, and how each kind of them is made.

    Attributes:
        scene: what is photographed.
        camera: by which camera.
        frames: from where.
        around: how many frames the camera took before each picture, and as many after it.
        seed: of the errors of the sensor.
        estimator: for pictures by themselves.
        only_changed: whether pictures of which no motion is found are left out.
    """

    scene: list[Plane]
    camera: Camera
    frames: list[Frame]
    around: int
    seed: int
    estimator: str
    only_changed: bool

    @property
    def kinds(self) -> dict[str, Callable[[int], unshutter.Rectified | unshutter.RectifiedFrame]]:
        """What makes each kind from the rolling-shutter picture of a number."""
        return {
            "rectified": partial(self._alone, told=False),
            "known_attitude": partial(self._alone, told=True),
            "sequence": partial(self._with_neighbours, found=False),
            "ratio_found": partial(self._with_neighbours, found=True),
            "dense": partial(self._picture, model="dense"),
            "chosen": partial(self._picture, model=None),
            "true_motion": lambda k: unshutter.rectify(
                self.seen(k), edges="keep", motion=self.frames[k].motion(self.camera)
            ),
        }

    def seen(self, k: int, later: float = 0) -> np.ndarray:
        """The rolling-shutter picture of a place, so many frames later."""
        return photograph(self.scene, self.camera, self.frames[k], rolling=True, later=later / RATIO)

    def _alone(self, k: int, told: bool) -> unshutter.Rectified:
        known = {}
        if told:
            held = attitude(self.frames[k], self.camera, self.seed + k)
            known = {"focal_px": self.camera.focal_px, **held}
        return unshutter.rectify(self.seen(k), estimator=self.estimator, reference="middle", edges="keep", **known)

    def _with_neighbours(self, k: int, found: bool) -> unshutter.Rectified:
        clip = (self.seen(k, later) for later in range(-self.around, self.around + 1))
        ratio = self.found_ratio if found else RATIO
        motions = unshutter.estimate_frames(
            clip, readout_ratio=ratio, focal_px=self.camera.focal_px, reference="middle"
        )
        return unshutter.rectify(self.seen(k), motion=list(motions)[self.around], edges="keep")

    def _picture(self, k: int, model: FrameModel | None) -> unshutter.RectifiedFrame:
        """As ``rectify --sequence`` makes it: what is known of the camera comes from all frames of the clip."""
        clip = [Photo.from_array(self.seen(k, later)) for later in range(-self.around, self.around + 1)]
        finder = CameraMotion(Clock(RATIO).stated_ratio, self.camera.focal_px)
        found = list(finder.frames(clip))[self.around]
        before, photo, after = clip[self.around - 1 : self.around + 2]
        how = SequenceOptions(
            Clock(RATIO).stated_ratio,
            Undo("middle", edges="keep"),
            ScanDirection.TOP_TO_BOTTOM,
            None,
            model,
            self.camera.focal_px,
        )
        return rectify_between(photo, before, after, how, found)

    @cached_property
    def found_ratio(self) -> float:
        """The readout ratio, from frames that the camera took at its first place."""
        camera = CameraMotion(focal_px=self.camera.focal_px)
        list(camera.frames(self.seen(0, later - _SEARCHED // 2) for later in range(_SEARCHED)))
        assert camera.ratio is not None
        print(f"readout ratio {camera.ratio}")
        return camera.ratio.value

    def write(self, folder: Path, kind: str) -> None:
        """Fills a folder with the pictures of a kind, and masks/ beside them where pixels are missing."""
        for part in ("images", "masks") if kind in self.kinds else ("images",):
            (folder / kind / part).mkdir(parents=True, exist_ok=True)
        for k, frame in enumerate(self.frames):
            name = f"{k:02d}.png"
            place = folder / kind / "images" / name
            if kind not in self.kinds:
                seen = photograph(self.scene, self.camera, frame, rolling=kind == "rolling_shutter")
                Photo.from_array(seen).save(place, overwrite=True)
                continue
            result = self.kinds[kind](k)
            if not result.changed:
                print(f"{kind}: {name} left {'out' if self.only_changed else 'as it is'}: {result.reason}")
                if self.only_changed:
                    place.unlink(missing_ok=True)
                    continue
            result.save(place, overwrite=True)
            # no features at the border of what the photo did not see: it is not part of the scene
            valid = cv2.erode(result.valid.astype(np.uint8) * 255, np.ones((9, 9)))
            cv2.imwrite(str(folder / kind / "masks" / f"{name}.png"), valid)


def attitude(frame: Frame, camera: Camera, seed: int) -> dict[str, float]:
    """What a sensor says of the camera at its first row: roll (clockwise) and tilt (upwards), off by about 0.3 deg."""
    x, y, z = rotation_matrix(frame.motion(camera).rotations[0]) @ frame.rotation @ [0, -1, 0]  # the world's up
    off = np.random.default_rng(seed).normal(0, _SENSOR_DEG, 2)
    found = np.degrees([np.arctan2(-x, -y), np.arcsin(z)]) + off
    return {"roll_deg": float(found[0]), "tilt_deg": float(found[1])}


def reconstruct(folder: Path, camera: Camera) -> pycolmap.Reconstruction | None:
    """COLMAP's sparse reconstruction of a folder's pictures, with the camera's calibration given and kept."""
    pycolmap.logging.minloglevel = pycolmap.logging.ERROR.value
    pycolmap.set_random_seed(0)
    database, images = folder / "database.db", folder / "images"
    database.unlink(missing_ok=True)
    reader = pycolmap.ImageReaderOptions()
    # COLMAP counts from the corner of the first pixel: its middle is at 0.5
    reader.camera_params = f"{camera.focal_px},{camera.focal_px},{camera.width / 2},{camera.height / 2}"
    if (folder / "masks").is_dir():
        reader.mask_path = str(folder / "masks")
    pycolmap.extract_features(
        database,
        images,
        camera_mode=pycolmap.CameraMode.SINGLE,
        camera_model="PINHOLE",
        reader_options=reader,
        sift_options={"max_num_features": 2500},
        device=pycolmap.Device.cpu,
    )
    pycolmap.match_exhaustive(database, device=pycolmap.Device.cpu)
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_principal_point = options.ba_refine_extra_params = False
    options.num_threads = 1  # the same answer every time
    (folder / "sparse").mkdir(exist_ok=True)
    models = pycolmap.incremental_mapping(database, images, folder / "sparse", options)
    return max(models.values(), key=lambda model: model.num_reg_images(), default=None)


def measure(model: pycolmap.Reconstruction | None, frames: list[Frame]) -> Outcome:
    """Compares a reconstruction with the truth."""
    if model is None:
        return Outcome(len(frames), 0, 0, 0.0, float("nan"), None, None)
    found = [image for image in model.images.values() if image.has_pose]
    truth = [frames[int(Path(image.name).stem)] for image in found]
    place = direction = None
    if len(found) >= 3:
        centers = np.array([image.projection_center() for image in found])
        scale, turn, shift = align(centers, np.array([frame.place for frame in truth]))
        off = scale * centers @ turn.T + shift - [frame.place for frame in truth]
        place = 100 * float(np.sqrt((off**2).sum(axis=1).mean()))
        rotations = [image.cam_from_world().rotation.matrix() @ turn.T for image in found]
        direction = float(np.median([angle(r @ f.rotation.T) for r, f in zip(rotations, truth, strict=True)]))
    return Outcome(
        len(frames),
        len(found),
        model.num_points3D(),
        model.compute_mean_track_length(),
        model.compute_mean_reprojection_error(),
        place,
        direction,
    )


def angle(rotation: np.ndarray) -> float:
    """By how much a rotation [3, 3] turns [deg]."""
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def align(source: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation [3, 3] and shift [3] that bring source [N, 3] closest to target (Umeyama 1991)."""
    middle = source.mean(axis=0), target.mean(axis=0)
    a, b = source - middle[0], target - middle[1]
    u, strength, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])  # a rotation, not a reflection
    turn = u * sign @ vt
    scale = float((strength * sign).sum() / (a**2).sum())
    return scale, turn, middle[1] - scale * turn @ middle[0]


def main() -> None:
    """Draws, reconstructs, prints a table and writes results.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for pictures and reconstructions")
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument(
        "--turn",
        type=float,
        nargs=3,
        default=(1.5, 3.0, 2.0),
        metavar=("X", "Y", "Z"),
        help="largest turn during the readout: up and down, left and right, roll [deg]",
    )
    parser.add_argument("--speed", type=float, default=0.0, metavar="M/S", help="how fast the camera walks meanwhile")
    parser.add_argument("--around", type=int, default=2, help="frames before each picture, and as many after it")
    parser.add_argument("--kinds", nargs="+", help="only these kinds of pictures")
    parser.add_argument("--only-changed", action="store_true", help="leave out pictures of which no motion is found")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--estimator", default=DEFAULT_ESTIMATOR)
    chosen = parser.parse_args()
    camera = Camera()
    frames = walk(camera, chosen.frames, tuple(chosen.turn), chosen.seed, chosen.speed)
    scene, how = draw_scene(chosen.seed), (chosen.estimator, chosen.only_changed)
    walked = Walk(scene, camera, frames, chosen.around, chosen.seed, *how)
    results = {}
    print(
        "| pictures | registered | points | pictures per point | reprojection [px] | places [cm] | directions [deg] |"
    )
    print("|---|---|---|---|---|---|---|")
    for kind in chosen.kinds or ("global_shutter", "rolling_shutter", *walked.kinds):
        walked.write(chosen.output, kind)
        out = measure(reconstruct(chosen.output / kind, camera), frames)
        results[kind] = asdict(out)
        place, direction = ("–" if v is None else f"{v:.2f}" for v in (out.place_cm, out.direction_deg))
        print(f"| {kind} | {out.registered} of {out.pictures} | {out.points} | {out.track:.2f} "
              f"| {out.reprojection_px:.3f} | {place} | {direction} |", flush=True)  # fmt: skip
    (chosen.output / "results.json").write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
