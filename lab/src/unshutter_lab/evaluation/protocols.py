"""The evaluation protocols: what each measures, and the cases it creates from the given folders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from unshutter.errors import UsageError
from unshutter.options import Clock
from unshutter_lab.evaluation.case import Case
from unshutter_lab.evaluation.clip_cases import RATIOS, SequenceCase, VideoCase
from unshutter_lab.evaluation.pair_cases import PairCase, logs_in, pairs_in, photos_in, videos_in
from unshutter_lab.evaluation.place_cases import place_cases
from unshutter_lab.evaluation.real_clips import METHODS, SECONDS, RealClipCase, check_programs, clips_in
from unshutter_lab.evaluation.rendered_clips import CLIPS, RENDERED_METHODS, RenderedClipCase
from unshutter_lab.evaluation.synthetic import Suite, SyntheticCase
from unshutter_lab.synthesis.panorama import places_in, shipped_places

WITHOUT_DATA = ("places", "rendered-clips")  # protocols that can be run with the laboratory's own places


@dataclass(frozen=True)
class Request:
    """The request for an evaluation. Together with the code, it determines every figure."""

    protocol: str  # one of PROTOCOLS
    data: tuple[Path, ...]  # folders; each is a group in the tables. None: the places that come with the laboratory
    photos: int | None = None  # maximum number of photos per folder, chosen by the seed; None for all
    per_photo: int = 2  # motions per photo
    seed: int = 0  # 0 or more
    trajectory: Path | None = None  # recorded motions, for the protocols trajectory and sequences
    # for pairs of consecutive frames, readout time / frame interval of each folder's camera
    readout_ratio: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.protocol not in PROTOCOLS:
            raise UsageError(f"unknown protocol '{self.protocol}': choose one of {', '.join(PROTOCOLS)}")
        if self.per_photo < 1 or self.seed < 0 or (self.photos is not None and self.photos < 1):
            raise UsageError("needs at least one photo of each folder, one motion for each, and a seed of 0 or more")
        if not self.data and self.protocol not in WITHOUT_DATA:
            raise UsageError(f"needs --data: folders of pictures; only {' and '.join(WITHOUT_DATA)} bring their own")
        if self.readout_ratio and (self.protocol != "pairs" or len(self.readout_ratio) != len(self.data)):
            raise UsageError("--readout-ratio is for the protocol pairs, and takes one number for each folder")
        for ratio in self.readout_ratio:
            Clock(ratio)  # raises if it is invalid


@dataclass(frozen=True)
class Protocol:
    """An evaluation protocol."""

    title: str  # title of its page
    # set of columns of its tables (tables.py): places, motion, still, pairs, video, sequences, rendered or real clips
    kind: str
    description: str  # what is measured, in a sentence or two
    cases: Callable[[Request], list[Case]]  # creates the cases for a request
    # what its tables list: folders, photos, or suites alone (with the photos of all folders pooled)
    rows: Literal["group", "photo", "suite"] = "group"
    methods: tuple[str, ...] = ()  # names of what it compares, if these are not estimators
    check: Callable[[list[str]], None] | None = None  # raises UnshutterError if some of these methods cannot be run


def _with_motion(*suites: Suite, recorded: bool = False) -> Callable[[Request], list[Case]]:
    """Returns a function that creates a case for each photo and draw in each suite."""

    def cases(request: Request) -> list[Case]:
        logs = logs_in(request.trajectory) if recorded else ()
        return [
            SyntheticCase(suite, group, photo, path, draw, request.seed, logs)
            for group, photos in _photos(request).items()
            for suite in suites
            for photo, path in photos.items()
            for draw in range(1 if suite.still else request.per_photo)
        ]

    return cases


def _photos(request: Request) -> dict[str, dict[str, Path]]:
    """Returns group -> name in its folder -> photo."""
    photos: dict[str, dict[str, Path]] = {}
    for group, folder in _groups(request).items():
        paths = photos_in(folder, request.photos, request.seed)
        photos[group] = {str(path.relative_to(folder)): path for path in paths}
    return photos


def _pairs(request: Request) -> list[Case]:
    groups = _groups(request)
    ratios: tuple[float | None, ...] = request.readout_ratio or (None,) * len(groups)
    return [
        PairCase(group, frame, ratio)
        for (group, folder), ratio in zip(groups.items(), ratios, strict=True)
        for frame in pairs_in(folder)
    ]


def _videos(request: Request) -> list[Case]:
    groups = _groups(request).items()
    return [VideoCase(group, frames, request.seed) for group, folder in groups for frames in videos_in(folder)]


def _sequences(request: Request) -> list[Case]:
    logs = logs_in(request.trajectory)
    return [
        SequenceCase(f"{group}/{photo}", path, log, ratio, request.seed)
        for log in logs
        for group, photos in _photos(request).items()
        for photo, path in photos.items()
        for ratio in RATIOS
    ]


def _real_clips(request: Request) -> list[Case]:
    groups = _groups(request).items()
    return [RealClipCase(group, clip) for group, folder in groups for clip in clips_in(folder)[: request.photos]]


def _rendered_clips(request: Request) -> list[Case]:
    places = [place for folder in _groups(request).values() for place in places_in(folder)]
    places = places or list(shipped_places().values())
    clips = CLIPS[: request.photos]
    return [RenderedClipCase(clip, places[k % len(places)], request.seed) for k, clip in enumerate(clips)]


def _places(request: Request) -> list[Case]:
    groups = {name: places_in(folder) for name, folder in _groups(request).items()}
    groups = groups or {"places": list(shipped_places().values())}
    return [
        case
        for group, folders in groups.items()
        for case in place_cases(group, folders[: request.photos], request.per_photo, request.seed)
    ]


def _groups(request: Request) -> dict[str, Path]:
    """Returns name in the tables -> folder."""
    groups = {folder.resolve().name: folder for folder in request.data}
    if len(groups) < len(request.data):
        raise UsageError("two of the folders have the same name: the tables could not keep them apart")
    return groups


PROTOCOLS = {
    "places": Protocol(
        "Places: photos, pairs and clips with exactly known motion",
        "places",
        "Views of real places in all directions (cube maps), as people hold cameras: 45 to 75 degrees across, at times "
        "looking up at towers, some of them upright. Each row has its own attitude, so the truth is exact for all "
        "three rotations. Still cameras; drawn hands at readouts of 20, 50 and 100 ms; pans of 20 to 60 degrees a "
        "second; the paper's quadratics; a hand with each row exposed for 1/60 s; streets of drawn houses with depth "
        "(parallax), by a hand that walks or rides past; pairs and clips of 16 frames at 30 a second, with a readout "
        "of 0.6 frames, of which methods that see one photo get the middle frame.",
        _places,
        rows="suite",
    ),
    "synthetic": Protocol(
        "Synthetic motions, 256 px",
        "motion",
        "The middle square of each photo at 256 px, the size that the paper's networks see, with random quadratic "
        "motions of Rengarajan et al. 2017. Every estimator is given the focal length: EXIF's, else 0.85 (width + "
        "height) of the whole photo, scaled to the picture.",
        _with_motion(Suite("256 px")),
    ),
    "native": Protocol(
        "Synthetic motions, native size",
        "motion",
        "The same photos and motions at the photo's own size. Errors are still in pixels of 256 rows.",
        _with_motion(Suite("native size", rows=None)),
    ),
    "trajectory": Protocol(
        "Recorded camera motions",
        "motion",
        "Windows of recorded camera rotation (t_x from turning about the vertical, r_z about the optical axis) at "
        "three strengths: readouts of 20, 50 and 100 ms, focal length and pictures of 256 px. The paper tests with "
        "the trajectories of Köhler et al. 2012 (§4.3), which we could not obtain.",
        _with_motion(*(Suite(f"readout {ms} ms", readout_s=ms / 1000) for ms in (20, 50, 100)), recorded=True),
        rows="suite",
    ),
    "undistorted": Protocol(
        "Undistorted photos: do no harm",
        "still",
        "Undistorted photos, in which every motion found is wrong. In the last suites photos lie on their side, as "
        "phones store portrait photos, or estimators know of a readout of 30 ms and an exposure of 1/60 s.",
        _with_motion(
            Suite("256 px", still=True),
            Suite("native size", rows=None, still=True),
            Suite("portrait, native size", rows=None, still=True, turned=1, orientation=6),
            Suite("1/60 s, native size", rows=None, still=True, exposure_s=1 / 60),
        ),
    ),
    "portrait": Protocol(
        "Portrait photos",
        "motion",
        "The same photos and motions, lying on their side as phones store portrait photos (EXIF orientation 6): rows "
        "are read along the scene's verticals.",
        _with_motion(
            Suite("256 px", turned=1, orientation=6), Suite("native size", rows=None, turned=1, orientation=6)
        ),
    ),
    "exposure": Protocol(
        "Photos of known exposure",
        "motion",
        "The same photos and motions, each row exposed for 1/1000 s or 1/60 s of a readout of 30 ms, and blurred by "
        "its motion. Estimators know both times.",
        _with_motion(
            Suite("1/1000 s, 256 px", exposure_s=1 / 1000),
            Suite("1/60 s, 256 px", exposure_s=1 / 60),
            Suite("1/1000 s, native size", rows=None, exposure_s=1 / 1000),
            Suite("1/60 s, native size", rows=None, exposure_s=1 / 60),
        ),
    ),
    "attitude": Protocol(
        "Photos of known roll and tilt",
        "motion",
        "The same photos and motions. Estimators know roll and tilt of the camera, each up to 1 degree off, as from an "
        "accelerometer; they are taken from the right angles of the undistorted photo, if it has any.",
        _with_motion(Suite("256 px", attitude_deg=1.0), Suite("native size", rows=None, attitude_deg=1.0)),
    ),
    "robustness": Protocol(
        "Degraded photos",
        "motion",
        "The same photos and motions (256 px) under JPEG compression (quality 30), noise (sigma 10), blur (sigma 1.5 "
        "px), at night (gamma 2, half the brightness, noise of sigma 6), at 128 px, enlarged to 2160 px, and lying on "
        "their side, with and without an orientation in EXIF.",
        _with_motion(
            Suite("as it is"),
            Suite("JPEG q 30", disturbance="jpeg"),
            Suite("noise", disturbance="noise"),
            Suite("blur", disturbance="blur"),
            Suite("night", disturbance="night"),
            Suite("128 px", rows=128),
            Suite("2160 px", rows=2160, of_pictures=False),
            Suite("on its left side", turned=1, orientation=6),
            Suite("on its right side", turned=-1, orientation=8),
            Suite("left side, no EXIF", turned=1),
        ),
        rows="suite",
    ),
    "pairs": Protocol(
        "Rolling-shutter and global-shutter pairs",
        "pairs",
        "Rolling-shutter frames and what a global shutter saw at the moment of their first or middle row, from two "
        "cameras or from `unshutter synthesize`. The ceiling is the best cubic t_x and r_z, fitted to both pictures. "
        "With `--readout-ratio`, the rows frames see the frames before and after, too: with one motion of the camera, "
        "with dense motion, and with the one that fits the frames. Columns `above NAME` say how much better "
        "they are than the published output of NAME for the same frames, on the pixels that the frame saw.",
        _pairs,
    ),
    "video": Protocol(
        "|R_F| over consecutive frames",
        "video",
        "In a caption, the paper gives |R_F| for a video without defining it. **Our reading**: SIFT matches between "
        "two consecutive rectified frames (middle row) that agree with one fundamental matrix (USAC, 1 px).",
        _videos,
    ),
    "sequences": Protocol(
        "Sequences with known motion",
        "sequences",
        "Each photo as 60 frames of a camera that turns about all three axes as a recorded one did (30 frames a "
        "second, 640x360 px, noise of 2 levels; logs of motion capture smoothed by 30 ms), its readout taking 0.3, 0.6 "
        "and 0.9 of a frame's time. *frames-camera* sees all frames, and finds the focal length and, unless given, the "
        "readout ratio. Methods that see one photo get every twelfth frame and the focal length.",
        _sequences,
    ),
    "rendered-clips": Protocol(
        "Rendered clips",
        "rendered clips",
        "Clips of places, 480x270 px, rendered at three times the size, averaged down, and encoded as H.264 in 4:4:4 "
        "(`crf` 18). Hands are drawn, and turn so fast that pixels are shifted by up to 3 to 10 px (in nine of ten "
        "frames), at 24, 30 and 60 frames a second: through a lens whose bend is not described by one number; "
        "walking, behind a fence, with people who pass; with little light (rows exposed for half a frame's time, noise "
        "of 6 levels); with every eighth frame repeated; on a drone that vibrates. PSNR of RGB [dB] is taken against "
        "noiseless global-shutter frames at the time of the middle row: of still surfaces that both shutters see, and "
        "of whole pictures, without a border of 6 %. *exact-map* is the bound: the true map, with near surfaces and "
        "people, applied to the decoded clip, and encoded as ours are. Shares are of its gain "
        "in dB. *unshutter-given* is given the readout ratio and the lens, or the focal length. x264 does not always "
        "write the same bytes, so that figures differ a little from run to run.",
        _rendered_clips,
        rows="photo",
        methods=RENDERED_METHODS,
    ),
    "real-clips": Protocol(
        "Real clips",
        "real clips",
        f"The first {SECONDS:g} seconds of real clips, as taken (*none*), straightened by `unshutter video` without "
        "options, and by FFmpeg's stabilisers (`deshake`, and vid.stab with a smoothing of 15, both with `-crf 18`). "
        "Nobody knows what a global shutter would have seen. Tracks that `unshutter video` does not use show how much "
        "frames are skewed and stretched from one to the next at the first and last rows, apart from what depth adds, "
        "in pixels of the clip: root mean square, 95th percentile and largest. A clip counts as worse if the first of "
        "these grows by more than 5 %, or the last by more than 10 %, and by more than 0.05 px, which encoding alone "
        "may add: five seconds are encoded again, also of clips that are copied. The readout ratio is found by "
        "regression; t is the ratio in units of its error. Sharpness is the variance of the Laplacian, divided by the "
        "clip's.",
        _real_clips,
        rows="photo",
        methods=METHODS,
        check=check_programs,
    ),
}
