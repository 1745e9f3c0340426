"""Measures how exact `unshutter poses` makes the camera's path of a walk, of frames as taken and of straightened ones.

    python lab/benchmarks/walk_poses.py [--seeds 1] [--readout 0.7] [--shake 1 2] [--output docs/results/walk-poses.md]

The walk, COLMAP and the measure are those of walks.py. Positions are those of the first, middle and last rows.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from walks import FOCAL, FPS, HEIGHT, TAKEN, Walk, modelled  # pyright: ignore[reportMissingImports]

import unshutter
from unshutter.motion.rotations import rotation_vector

STRAIGHTENED = "straightened, ratio and focal length given"


def rows_of(seed: int, shake: float, ratio: float) -> Iterator[str]:
    """Yields the rows of a walk."""
    walk = Walk(seed, shake, ratio)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        taken, straight, motions = folder / "taken.mkv", folder / "straight.mkv", folder / "motions.json"
        walk.film(taken, False)
        unshutter.rectify_clip(
            taken, straight, readout_ratio=ratio, focal_px=FOCAL, edges="keep", save_motion=motions, overwrite=True
        )
        for kind, film in ((TAKEN, taken), (STRAIGHTENED, straight)):
            modelled(walk, film, folder)
            model = max(
                (folder / f"{film.stem}-model").iterdir(), key=lambda each: (each / "images.bin").stat().st_size
            )
            refined = unshutter.camera_poses(model, motions)
            yield row(
                shake, kind, "COLMAP", walk, [each.picture.world_to_camera[None] for each in refined.pictures], refined
            )
            (model / "points3D.bin").unlink()
            for how, poses in (("without points", unshutter.camera_poses(model, motions)), ("refined", refined)):
                ends = [each.world_to_camera[[0, len(each.lines) // 2, -1]] for each in poses.pictures]
                yield row(shake, kind, how, walk, ends, poses)


def row(shake: float, kind: str, how: str, walk: Walk, poses: list[np.ndarray], of: unshutter.CameraPoses) -> str:
    """Returns a row of the table: errors after the similarity that fits the middle rows best."""
    frames = np.array([int(Path(each.picture.name).stem) for each in of.pictures])
    found = np.stack(poses)  # [pictures, rows, 4, 4]
    turns = found[..., :3, :3]
    places = -np.einsum("prji,prj->pri", turns, found[..., :3, 3])
    shares = [0.5] if found.shape[1] == 1 else [0.0, 0.5, 1.0]
    middle = len(shares) // 2
    true = [walk.poses((frames + walk.ratio * share * (HEIGHT - 1) / HEIGHT) / FPS) for share in shares]
    scale, turn, shift = similarity(places[:, middle], true[middle][1])
    off, left = [], []
    for k, (rotations, positions) in enumerate(true):
        off.append(np.linalg.norm(scale * places[:, k] @ turn.T + shift - positions, axis=1))
        left.append(rotations.transpose(0, 2, 1) @ turns[:, k])
    u, _, vt = np.linalg.svd(left[middle].mean(axis=0))
    angles = [np.degrees(np.linalg.norm(rotation_vector((u @ vt).T @ each), axis=1)) for each in left]
    figures = [f"{100 * rms(off[k]):.2f} | {rms(angles[k]):.3f}" for k in (middle, -1)]
    if len(shares) == 1:
        figures[1] = " | "
    return f"| {shake:g}x | {kind} | {how} | {len(frames)} | {' | '.join(figures)} |"


def rms(values: np.ndarray) -> float:
    """Returns the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def similarity(found: np.ndarray, true: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Returns the scale, rotation and shift that bring positions closest to the true ones."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, sizes, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    turn = u * signs @ vt
    scale = float((sizes * signs).sum() / (a**2).sum())
    return scale, turn, true.mean(axis=0) - scale * turn @ found.mean(axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--readout", type=float, default=0.7, help="readout time / frame interval")
    parser.add_argument("--shake", type=float, nargs="+", default=[1.0, 2.0], help="strength of the hand")
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    lines = [
        "| hand | frames | poses | pictures | positions, cm | rotations, ° | of last rows, cm | ° |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for seed in options.seeds:
        for shake in options.shake:
            for line in rows_of(seed, shake, options.readout):
                print(f"seed {seed}: {line}", flush=True)
                lines.append(line)
    if options.output is not None:
        options.output.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
