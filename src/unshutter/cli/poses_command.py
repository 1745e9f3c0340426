"""``unshutter poses``: the camera's poses at the rows of the pictures of a 3D model."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, field
from pathlib import Path

from unshutter.cli.arguments import Command
from unshutter.options import option
from unshutter.poses.camera_poses import PoseFormat
from unshutter.poses.row_poses import PoseOptions
from unshutter.progress import tell
from unshutter.storage.locations import RunFiles


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``unshutter poses``."""

    colmap: Path = option(MISSING, "Folder of a COLMAP model, binary or text.", metavar="FOLDER", names="input")
    motions: Path = option(
        MISSING,
        "Motion file of the clip that the pictures are frames of (`video --save-motion`), or a folder with a motion "
        "file for each (`rectify --sequence --save-motion`).",
        names="input",
    )
    output: Path = option(
        MISSING,
        "Folder to write the poses into.",
        short="-o",
        metavar="FOLDER",
        names="results",
    )
    format: PoseFormat = option(
        "files",
        "files: gsplat.npz, transforms.json and poses.csv; ncore: a sequence of NVIDIA's NCore v4. Default: files.",
    )
    images: str = option(
        "images",
        "Folder of the pictures, as transforms.json names it; an NCore sequence holds the pictures. Default: images.",
        names="word",
    )
    overwrite: bool = option(False, "Replace existing outputs.")
    options: PoseOptions = field(default_factory=PoseOptions)


def run(arguments: Arguments) -> int:
    """Finds and writes the poses, and reports them; returns the exit code."""
    from unshutter.poses import camera_poses, ncore
    from unshutter.poses.row_poses import find_poses

    files = RunFiles(arguments, reads=arguments.colmap.glob("*"), folders=[arguments.output])
    for name in ncore.NAMES if arguments.format == "ncore" else camera_poses.NAMES:
        files.writes(name, arguments.output / name)
        files.check(arguments.output / name)
    poses = find_poses(arguments.colmap, arguments.motions, arguments.options)
    camera_poses.save_poses(poses, arguments.format, arguments.output, arguments.images, arguments.overwrite)
    tell(f"{arguments.colmap} -> {arguments.output}: {poses.described(arguments.format)}")
    return 0


COMMAND = Command(
    """Write the camera's pose at each row of the pictures of a COLMAP model, for gsplat, nerfstudio and NCore.

Each row of a rolling-shutter picture has a pose of its own. COLMAP finds one for a picture; the motion within it, the
positions of its neighbours and the rows on which it shows the model's points give the others.""",
    Arguments,
    run,
    when_stopped="no half-written file is left",
)
