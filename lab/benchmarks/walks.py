"""Measures what a rolling shutter costs a 3D model of a walk, and what straightening its clip leaves of that.

    python lab/benchmarks/walks.py [--seeds 1] [--readout 0.7] [--shake 1,2] [--output docs/results/walks.md]

A hall with pillars is drawn, each row at its own moment, as a phone sees it that walks past at 1.3 m/s in a hand
(640x480 px, 60 frames at 30 a second). COLMAP (pycolmap) gets every second frame, of one camera with an unknown focal
length. Its camera path, brought onto the true one by a similarity, is off by some centimetres: harm is what it is off
more than that of global-shutter frames, as a share of what it is for frames as taken.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np

import unshutter
from unshutter.frames.pyav import av
from unshutter.motion.rotations import rotation_matrix, rotation_vector

HEIGHT, WIDTH, FOCAL, FPS, FRAMES, EVERY = 480, 640, 520.0, 30, 60, 2
WALK = np.array([1.3, 0.0, 0.25])  # m/s, along the wall and a little towards it
STEPS_HZ, BOB_M = 1.9, 0.02  # of the walker
HAND_HZ = np.array([0.6, 1.5, 2.8, 4.4])
HAND_DEG = np.array([[1.2, 0.8, 0.5, 0.25], [1.6, 1.0, 0.6, 0.3], [1.0, 0.7, 0.4, 0.2]])  # about x, y and z
FIGURES = ("reprojection_px", "position_cm", "rotation_deg", "focal_percent")
GLOBAL, TAKEN = "global shutter", "as taken"
METHODS = {
    "no option": {},
    "ratio and focal length given": {"focal_px": FOCAL},
    "the same, model dense": {"focal_px": FOCAL, "model": "dense"},
}


@dataclass(frozen=True)
class Face:
    """A textured rectangle: a corner, its two sides [m], and its picture."""

    corner: np.ndarray
    sides: np.ndarray
    picture: np.ndarray


@dataclass(frozen=True)
class Row:
    """What COLMAP makes of one film."""

    shake: float
    frames: str
    pictures: int
    reprojection_px: float
    position_cm: float
    rotation_deg: float
    focal_percent: float
    readout_ms: float | None


class Walk:
    """A hall and the path of a phone through it."""

    def __init__(self, seed: int, shake: float, ratio: float):
        self.rng = np.random.default_rng(seed)
        self.phases = self.rng.uniform(0, 2 * np.pi, HAND_DEG.shape)
        self.shake = shake
        self.ratio = ratio
        self.faces = list(self._faces())

    def _faces(self) -> Iterator[Face]:
        hall = [((-7, -3, 8.5), (20, 0, 0), (0, 4.6, 0)), ((-7, 1.6, -2), (20, 0, 0), (0, 0, 10.5))]
        hall += [((x, -3, -2), (0, 0, 10.5), (0, 4.6, 0)) for x in (-7, 13)] + [
            ((-7, -3, -2), (20, 0, 0), (0, 0, 10.5))
        ]
        for x in np.arange(-3.0, 8.0, 1.4):
            z, wide, high = self.rng.uniform(3.2, 7.0), self.rng.uniform(0.5, 1.1), self.rng.uniform(1.0, 2.8)
            near = (x, 1.6 - high, z)
            hall += [(near, (wide, 0, 0), (0, high, 0)), (near, (0, 0, 0.6), (0, high, 0))]
            hall += [((x + wide, 1.6 - high, z), (0, 0, 0.6), (0, high, 0)), (near, (wide, 0, 0), (0, 0, 0.6))]
        for corner, *sides in hall:
            yield Face(np.array(corner, float), np.array(sides, float), self._painted(np.linalg.norm(sides, axis=1)))

    def _painted(self, metres: np.ndarray) -> np.ndarray:
        """Returns a picture of clouds and tiles, 120 px to the metre or fewer."""
        size = np.clip(120 * metres, 96, 1500).astype(int)
        picture = np.full((size[1], size[0], 3), 128.0, np.float32)
        for cells in (5, 11, 23, 47, 95, 190):
            noise = self.rng.normal(0, 30 / np.sqrt(np.log2(cells)), (cells, cells, 3)).astype(np.float32)
            picture += cv2.resize(noise, tuple(size.tolist()), interpolation=cv2.INTER_CUBIC)
        for _ in range(int(9 * metres[0] * metres[1]) + 30):
            place, half = self.rng.uniform(0, size), self.rng.uniform(3, 22, 2)
            box = cv2.boxPoints((place.tolist(), half.tolist(), float(self.rng.uniform(0, 90))))
            cv2.fillPoly(picture, [box.astype(np.int32)], self.rng.uniform(20, 235, 3).tolist(), cv2.LINE_AA)
        return cv2.GaussianBlur(np.clip(picture, 0, 255), (0, 0), 0.7)

    def poses(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns rotations [n, 3, 3], from the world to the camera, and positions [n, 3] at times [s]."""
        waves = np.sin(2 * np.pi * HAND_HZ * times[:, None, None] + self.phases) * HAND_DEG
        rotations = rotation_matrix(np.radians(self.shake * waves.sum(axis=-1)))
        bob = BOB_M * np.sin(2 * np.pi * STEPS_HZ * times)
        sway = 0.75 * BOB_M * np.sin(np.pi * STEPS_HZ * times + 1)
        return rotations, WALK * times[:, None] + np.stack([0 * times, bob, sway], axis=-1)

    def middles(self, frames: np.ndarray) -> np.ndarray:
        """Returns the times of the frames' middle rows [s]."""
        return (frames + 0.5 * self.ratio * (HEIGHT - 1) / HEIGHT) / FPS

    def picture(self, frame: int, is_global: bool) -> np.ndarray:
        """Returns a frame, each row at its own moment or all at that of the middle one."""
        rows = np.full(HEIGHT, (HEIGHT - 1) / 2) if is_global else np.arange(HEIGHT)
        rotations, positions = self.poses((frame + self.ratio * rows / HEIGHT) / FPS)
        across, down = np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2
        rays = np.stack(np.broadcast_arrays(across / FOCAL, down[:, None] / FOCAL, 1.0), axis=-1)
        rays = np.einsum("rji,rcj->rci", rotations, rays)
        nearest = np.full((HEIGHT, WIDTH), np.inf)
        out = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        for face in self.faces:
            part = self._part(face, rotations, positions)
            normal = np.cross(*face.sides)
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = ((face.corner - positions[part[0]]) @ normal)[:, None] / (rays[part] @ normal)
            seen = (distance > 0.05) & (distance < nearest[part])
            at = positions[part[0], None] + np.where(seen, distance, 0)[..., None] * rays[part] - face.corner
            share = at @ face.sides.T / (face.sides**2).sum(axis=1)
            seen &= ((share >= 0) & (share < 1)).all(axis=-1)
            if seen.any():
                place = (share * (face.picture.shape[1] - 1, face.picture.shape[0] - 1)).astype(np.float32)
                drawn = cv2.remap(face.picture, place[..., 0], place[..., 1], cv2.INTER_LINEAR)
                out[part][seen] = np.clip(drawn[seen] + 0.5, 0, 255)
                nearest[part][seen] = distance[seen]
        return out

    def _part(self, face: Face, rotations: np.ndarray, positions: np.ndarray) -> tuple[slice, slice]:
        """Returns the rows and columns in which a face can be, all of them if it reaches behind the camera."""
        corners = face.corner + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) @ face.sides
        x, y, z = np.einsum("rij,rcj->irc", rotations[::60], corners - positions[::60, None])
        if z.min() < 0.1:
            return slice(None), slice(None)
        col, row = x / z * FOCAL + WIDTH / 2, y / z * FOCAL + HEIGHT / 2
        ends = (
            np.clip([at.min() - 8, at.max() + 9], 0, size).astype(int) for at, size in ((row, HEIGHT), (col, WIDTH))
        )
        rows, columns = (slice(*each.tolist()) for each in ends)
        return rows, columns

    def film(self, path: Path, is_global: bool) -> None:
        """Writes a lossless film of the walk."""
        with av().open(str(path), "w") as out:
            stream = out.add_stream("ffv1", rate=FPS)
            stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv444p"
            for number in range(FRAMES):
                frame = av().VideoFrame.from_ndarray(self.picture(number, is_global), format="rgb24")
                out.mux(stream.encode(frame))
            out.mux(stream.encode(None))


def modelled(walk: Walk, film: Path, folder: Path) -> tuple[int, float, float, float, float]:
    """Returns what COLMAP makes of a film.

    Returns:
        Number of pictures, reprojection error [px], errors of positions [cm], rotations [deg] and focal length [%].
    """
    pycolmap = import_module("pycolmap")  # not needed to draw

    pictures = folder / f"{film.stem}-pictures"
    pictures.mkdir()
    with av().open(str(film)) as clip:
        for number, frame in enumerate(clip.decode(video=0)):
            if number % EVERY == 0:
                cv2.imwrite(str(pictures / f"{number:04d}.png"), frame.to_ndarray(format="bgr24"))
    database = folder / f"{film.stem}.db"
    camera = pycolmap.ImageReaderOptions(camera_model="SIMPLE_PINHOLE")
    features = pycolmap.FeatureExtractionOptions()
    features.sift.max_num_features = 3000
    single = pycolmap.CameraMode.SINGLE
    pycolmap.extract_features(
        database, pictures, camera_mode=single, reader_options=camera, extraction_options=features
    )
    pycolmap.match_sequential(database, pairing_options=pycolmap.SequentialPairingOptions(overlap=8))
    models = pycolmap.incremental_mapping(database, pictures, folder / f"{film.stem}-model")
    model = max(models.values(), key=lambda each: each.num_reg_images())
    seen = sorted((each for each in model.images.values() if each.has_pose), key=lambda each: each.name)
    rotations, positions = walk.poses(walk.middles(np.array([int(each.name[:4]) for each in seen])))
    found = np.array([each.projection_center() for each in seen])
    off = aligned(found, positions) - positions
    turns = np.array([each.cam_from_world().rotation.matrix() for each in seen])
    relative = rotations.transpose(0, 2, 1) @ turns
    u, _, vt = np.linalg.svd(relative.mean(axis=0))
    left = np.linalg.norm(rotation_vector((u @ vt).T @ relative), axis=1)
    (lens,) = model.cameras.values()
    return (
        len(seen),
        float(model.compute_mean_reprojection_error()),
        100 * float(np.sqrt((off**2).sum(axis=1).mean())),
        float(np.degrees(np.sqrt((left**2).mean()))),
        100 * float(lens.params[0] / FOCAL - 1),
    )


def aligned(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Returns positions [n, 3] after the similarity that brings them closest to the true ones."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, sizes, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    scale = (sizes * signs).sum() / (a**2).sum()
    return scale * a @ (u * signs @ vt).T + true.mean(axis=0)


def measured(seed: int, shake: float, ratio: float, note: Callable[[str], None]) -> list[Row]:
    """Returns the rows of one walk."""
    walk = Walk(seed, shake, ratio)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        films = {GLOBAL: folder / "global.mkv", TAKEN: folder / "taken.mkv"}
        for kind, path in films.items():
            walk.film(path, kind == GLOBAL)
        for kind in (*films, *METHODS):
            readout_ms = None
            path = films.get(kind, folder / f"{len(rows)}.mkv")
            if kind in METHODS:
                given = {"readout_ratio": ratio} if METHODS[kind] else {}
                outcome = unshutter.rectify_clip(films[TAKEN], path, edges="keep", **given, **METHODS[kind])
                readout_ms = outcome.readout_time.ms
            rows.append(Row(shake, kind, *modelled(walk, path, folder), readout_ms))
            note(f"seed {seed}, {rows[-1]}")
    return rows


def page(rows: list[Row], command: str) -> str:
    """Returns the page with the table."""
    lines = [
        "# A walk, for COLMAP",
        "",
        "A drawn hall with pillars, seen by a phone that walks past at 1.3 m/s in a hand, which turns by 8 to 13°/s at "
        "1x: 640x480 px, 60 frames at 30 a second, each row at its own moment. COLMAP gets every second frame, of one "
        "camera of unknown focal length; its path is brought onto the true one. *Harm left*: by how much positions are "
        "off more than those of global-shutter frames, as a share of what they are for frames as taken.",
        "",
        "```sh",
        command,
        "```",
        "",
        "| hand | frames | readout, ms | reprojection, px | positions, cm | rotations, ° | focal, % | harm left |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        same = {each.frames: each for each in rows if each.shake == row.shake}
        best, worst = same[GLOBAL].position_cm, same[TAKEN].position_cm
        harm = "" if row.frames in (GLOBAL, TAKEN) else f"{(row.position_cm - best) / (worst - best):.2f}"
        found = "" if row.readout_ms is None else f"{row.readout_ms:.1f}"
        figures = (
            f"{row.reprojection_px:.2f} | {row.position_cm:.2f} | {row.rotation_deg:.3f} | {row.focal_percent:+.2f}"
        )
        lines.append(f"| {row.shake:g}x | {row.frames} | {found} | {figures} | {harm} |")
    return "\n".join([*lines, "", "[All results](index.md)", ""])


def mean_of(rows: list[Row]) -> list[Row]:
    """Returns the mean rows of several walks."""
    means = []
    for shake, kind in dict.fromkeys((row.shake, row.frames) for row in rows):
        alike = [asdict(row) for row in rows if (row.shake, row.frames) == (shake, kind)]
        found = [each["readout_ms"] for each in alike if each["readout_ms"] is not None]
        mean = {key: float(np.mean([each[key] for each in alike])) for key in FIGURES}
        readout_ms = float(np.mean(found)) if found else None
        means.append(Row(shake, kind, alike[0]["pictures"], **mean, readout_ms=readout_ms))
    return means


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--readout", type=float, default=0.7, help="readout time / frame interval")
    parser.add_argument("--shake", type=float, nargs="+", default=[1.0, 2.0], help="strength of the hand")
    parser.add_argument("--output", type=Path, default=Path("docs/results/walks.md"))
    options = parser.parse_args()
    rows = [
        row
        for shake in options.shake
        for seed in options.seeds
        for row in measured(seed, shake, options.readout, lambda text: print(text, flush=True))
    ]
    seeds = " ".join(map(str, options.seeds))
    options.output.write_text(
        page(mean_of(rows), f"python lab/benchmarks/walks.py --seeds {seeds} --readout {options.readout}")
    )
    with options.output.with_suffix(".csv").open("w", newline="") as out:
        table = csv.DictWriter(out, asdict(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(map(asdict, rows))


if __name__ == "__main__":
    main()
