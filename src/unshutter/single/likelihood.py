"""The line segments of a photo, and their likelihood given a row motion and a camera: a scene full of right angles.

The edges of the scene run along three orthogonal directions (Coughlan and Yuille's Manhattan world), seen by a camera
with square pixels: once rectified by the right motion, every segment points to one of three vanishing points or is an
outlier. Shear rotates verticals only, a camera held askew rotates everything: this is how the likelihood distinguishes
them.

The residuals are the angles between rectified segments and the directions to the vanishing points. For one hypothesis,
an end point p of a segment, and u = row of p + 1/2:

    q = R(-r_z(u)) (p - (t_x(u), 0))                the end point rectified (paper, Eq. 1)
    d = q2 - q1,  m = (q1 + q2) / 2                 direction and centre of the rectified segment
    v = diag(f, f, 1) R_z(roll) R_x(tilt) w(yaw)    a vanishing point, homogeneous
    e = (v_x, v_y) - v_z m                          direction from the centre to the vanishing point
    a = arg(e) - arg(d)                             angle between expected and observed direction
    sin a = (d x e) / (|d| |e|)                     the residual, which does not distinguish a point from its antipode

``J_x`` is the derivative with respect to x of the value next to it. Shapes are [S, 3, N]: hypotheses, vanishing points
(vertical and two horizontal ones), segments. Coordinates are centred (columns right, rows down) and divided by the
number of rows, so that the picture is one unit high at any size and its proportions are preserved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from unshutter.motion.opencv_threads import no_opencv_threads
from unshutter.motion.shapes import Float, UInt8
from unshutter.reasons import Code, Reason
from unshutter.single.estimator import View
from unshutter.single.prior import (
    LOG_FOCAL,
    MOTION,
    ROLL,
    TILT,
    UNKNOWNS,
    YAW,
    KnownCamera,
    MotionKind,
    NetworkObservation,
    Prior,
    PriorParams,
)

Vector = tuple[np.ndarray, ...]  # its components


class EndPoints:
    """One end of every segment, as observed: [N, 2] points (col, row), centred, in rows."""

    def __init__(self, points: np.ndarray):
        self.col = points[:, 0]
        self.row = points[:, 1]
        self.powers = (points[:, 1:] + 0.5) ** np.arange(1, 4)  # [N, 3] of u

    def rectified(self, motions: np.ndarray) -> RectifiedPoints:
        """Returns the points with S motions [S, 6] undone."""
        return RectifiedPoints(self.col, self.row, motions[:, 0:3] @ self.powers.T, motions[:, 3:6] @ self.powers.T)


class RectifiedPoints:
    """q = R(-r_z) (p - (t_x, 0)).

    Args:
        col, row: p, [N] each.
        tx, rz: [S, N] motion at these points.
    """

    def __init__(self, col: np.ndarray, row: np.ndarray, tx: np.ndarray, rz: np.ndarray):
        self._cos, self._sin = np.cos(rz), np.sin(rz)
        x = col - tx
        self.col = x * self._cos + row * self._sin
        self.row = row * self._cos - x * self._sin

    @property
    def J_tx(self) -> Vector:
        """dq/dt_x = -R(-r_z) (1, 0)."""
        return -self._cos, self._sin

    @property
    def J_rz(self) -> Vector:
        """dq/dr_z = (q_y, -q_x)."""
        return self.row, -self.col


class VanishingPoints:
    """v = diag(f, f, 1) R_z(roll) R_x(tilt) w(yaw), where w are the scene's directions (right, down, ahead).

    These are w = (0, 1, 0), (cos yaw, 0, sin yaw), (-sin yaw, 0, cos yaw).

    Args:
        rotation: roll [rad] of a camera held upright: a quarter turn if the scene lies on its side.
    """

    def __init__(self, unknowns: np.ndarray, rotation: float = 0.0):
        self._focal = np.exp(unknowns[:, LOG_FOCAL, None])
        self._roll = unknowns[:, ROLL] + rotation
        self._tilt = unknowns[:, TILT]
        self._yaw = unknowns[:, YAW]
        none = np.zeros_like(self._yaw)
        one = np.ones_like(self._yaw)
        cos = np.cos(self._yaw)
        sin = np.sin(self._yaw)
        self._seen = self._in_camera([none, cos, -sin], [one, none, none], [none, sin, cos])
        self.v = self._projected(*self._seen)

    @property
    def J_roll(self) -> Vector:
        """dv/droll = diag(f, f, 1) (-y, x, 0), with (x, y, z) = R_z R_x w."""
        x, y, z = self._seen
        return self._projected(-y, x, 0 * z)

    @property
    def J_tilt(self) -> Vector:
        """dv/dtilt = diag(f, f, 1) R_z (0, z, -y), with (x, y, z) = R_x w."""
        x, y, z = self._seen
        cos = np.cos(self._roll)[:, None]
        sin = np.sin(self._roll)[:, None]
        return self._projected(-sin * z, cos * z, -(y * cos - x * sin))

    @property
    def J_log_focal(self) -> Vector:
        """dv/dlog f = (v_x, v_y, 0)."""
        x, y, z = self.v
        return x, y, 0 * z

    @property
    def J_yaw(self) -> Vector:
        """dv/dyaw = diag(f, f, 1) R_z R_x dw/dyaw."""
        none = np.zeros_like(self._yaw)
        cos = np.cos(self._yaw)
        sin = np.sin(self._yaw)
        return self._projected(*self._in_camera([none, -sin, -cos], [none, none, none], [none, cos, -sin]))

    def _in_camera(self, x: list, y: list, z: list) -> Vector:
        """Computes R_z R_x (x, y, z) for three directions, each component a list of arrays [S]: [S, 3] each."""
        right, down, ahead = (np.stack(a, -1) for a in (x, y, z))
        cos = np.cos(self._tilt)[:, None]
        sin = np.sin(self._tilt)[:, None]
        down, ahead = cos * down + sin * ahead, cos * ahead - sin * down
        cos = np.cos(self._roll)[:, None]
        sin = np.sin(self._roll)[:, None]
        return cos * right - sin * down, sin * right + cos * down, ahead

    def _projected(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Vector:
        """Computes diag(f, f, 1) (x, y, z): [S, 3] each -> [S, 3, 1] each."""
        return (self._focal * x)[..., None], (self._focal * y)[..., None], z[..., None]


class AngleResiduals:
    """The sine of a for every hypothesis, vanishing point and segment."""

    def __init__(self, ends: tuple[EndPoints, EndPoints], unknowns: np.ndarray, rotation: float = 0.0):
        motions = unknowns[:, MOTION]
        if (motions == motions[0]).all():  # one motion, many cameras: segments are rectified only once
            motions = motions[:1]
        self._ends = ends
        self._q = one, other = ends[0].rectified(motions), ends[1].rectified(motions)
        self._vanishing = VanishingPoints(unknowns, rotation)
        self._d = dx, dy = other.col - one.col, other.row - one.row
        self._d2 = dx**2 + dy**2 + 1e-18
        self._m = (one.col + other.col)[:, None] / 2, (one.row + other.row)[:, None] / 2
        x, y, z = self._vanishing.v
        self._e = ex, ey = x - self._m[0] * z, y - self._m[1] * z
        self._e2 = ex**2 + ey**2 + 1e-12
        dx = dx[:, None]
        dy = dy[:, None]
        size = np.sqrt(self._e2 * self._d2[:, None])
        self.sine = (dx * ey - dy * ex) / size
        self.cosine = (dx * ex + dy * ey) / size

    def jacobian(self, camera_only: bool = False) -> np.ndarray:
        """Returns d sin a / d unknowns = cos a da/d unknowns, [S, 10, 3, N]; zero for the motion if ``camera_only``."""
        J = np.zeros((len(self.sine), UNKNOWNS, *self.sine.shape[1:]))
        if not camera_only:
            one, other = self._q
            powers = [end.powers.T for end in self._ends]
            for first, J_q in ((0, (one.J_tx, other.J_tx)), (3, (one.J_rz, other.J_rz))):
                J_one, J_other = (J_end * self.cosine for J_end in self._J_ends(*J_q))
                for k in range(3):  # t_x and r_z at an end are polynomials in its u
                    np.add(J_one * powers[0][k], J_other * powers[1][k], out=J[:, first + k])
        v = self._vanishing
        for k, J_v in ((ROLL, v.J_roll), (TILT, v.J_tilt), (LOG_FOCAL, v.J_log_focal), (YAW, v.J_yaw)):
            np.multiply(self._J_vanishing(J_v), self.cosine, out=J[:, k])
        return J

    def _J_vanishing(self, J_v: Vector) -> np.ndarray:
        """Returns da/dx if only v depends on x: d arg(e)/dx = (e x J_e) / |e|^2 with J_e = J_v,xy - J_v,z m."""
        x, y, z = J_v
        ex, ey = self._e
        mx, my = self._m
        return (ex * (y - my * z) - ey * (x - mx * z)) / self._e2

    def _J_ends(self, J_q1: Vector, J_q2: Vector) -> tuple[np.ndarray, np.ndarray]:
        """Returns da/dx if only q1 depends on x, and if only q2 does.

        da/dx = (e x J_e) / |e|^2 - (d x J_d) / |d|^2 with J_e = -v_z J_q / 2, J_d = -J_q1 or J_q2.
        """
        dx, dy = self._d
        ex, ey = self._e
        half = self._vanishing.v[2] / (2 * self._e2)
        of_x = ey * half
        of_y = ex * half
        J_1, J_2 = (
            of_x * x[:, None] - of_y * y[:, None] - (side * (dx * y - dy * x) / self._d2)[:, None]
            for (x, y), side in ((J_q1, -1), (J_q2, 1))
        )
        return J_1, J_2


_PARTS = 4  # horizontally and vertically


class ManhattanLikelihood:
    """Energy (negative log posterior) of hypotheses [S, 10] (prior.py), and its derivatives.

    Each segment's sine comes from a mixture: accurate and inaccurate edges, towards each of the three
    vanishing points, and outliers of arbitrary direction. The segments are [N, 4] end points, centred, in rows, found
    in a picture with so many rows and this aspect, width / height.
    """

    def __init__(
        self,
        segments: np.ndarray,
        rows: int,
        aspect: float = 1.0,
        params: PriorParams | None = None,
        known: KnownCamera | None = None,
        observation: NetworkObservation | None = None,
        kinds: Sequence[MotionKind] = (),
    ):
        b = params or PriorParams()
        self.known = known or KnownCamera()
        self.prior = Prior(b, self.known, aspect, observation, kinds)
        self.segments = segments
        self.aspect = aspect
        self._ends = EndPoints(segments[:, :2]), EndPoints(segments[:, 2:])
        self.part = _parts(segments, aspect)
        self._turn = math.atan2(self.known.up[0], -self.known.up[1])
        length_px = np.hypot(*(segments[:, 2:] - segments[:, :2]).T) * rows
        self.weight = np.minimum(length_px / b.full_weight_px, 1) * b.independent_share
        exact = b.sigma_exact + b.sigma_end_px / length_px
        sigmas = np.stack([exact, np.hypot(exact, b.sigma_sloppy)])  # [2, N]
        self._precisions = 1 / sigmas**2
        shares = np.array([[1 - b.sloppy_share], [b.sloppy_share]]) * (1 - b.outlier_share)
        horizontal_share = (1 - b.vertical_share) / 2
        directions = np.array([[b.vertical_share], [horizontal_share], [horizontal_share]])
        # [2, 3, N]: each Gaussian's share times its density at its peak
        self._peaks = (shares / (sigmas * math.sqrt(2 * math.pi)))[:, None] * directions
        self._anywhere = b.outlier_share / math.pi

    def energy(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the energy of unknowns: [S, 10] -> [S]."""
        return self._of_segments(self._residuals(unknowns))[0] + self.prior.expanded(unknowns)[0]

    def expanded(
        self, unknowns: np.ndarray, kind: np.ndarray | None = None, camera_only: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the energy [S], its gradient [S, 10] and its Gauss-Newton Hessian [S, 10, 10].

        With the residuals r, their precisions W and J = dr/d unknowns: gradient J^T W r, Hessian J^T W J, plus those of
        the prior.

        Args:
            kind: [S] index of each motion's kind in the prior; the first by default.
            camera_only: omit derivatives of the segments' energy with respect to the motion; a third faster.
        """
        residuals = self._residuals(unknowns)
        energy, precision = self._of_segments(residuals)
        J = residuals.jacobian(camera_only).reshape(len(unknowns), UNKNOWNS, -1)  # [S, 10, 3 * N]
        J_weighted = J * precision.reshape(len(unknowns), 1, -1)
        gradient = (J_weighted @ residuals.sine.reshape(len(unknowns), -1, 1))[..., 0]
        prior, prior_gradient, prior_hessian = self.prior.expanded(unknowns, kind)
        return energy + prior, gradient + prior_gradient, J_weighted @ J.transpose(0, 2, 1) + prior_hessian

    def lines_gain(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the log-likelihood ratio of the segments against chance, [S, 10] -> [S], nats per unit of weight."""
        by_chance = self.weight.sum() * math.log(math.pi)
        return (by_chance - self._of_segments(self._residuals(unknowns))[0]) / max(self.weight.sum(), 1e-9)

    def of_segments(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the log-likelihood of each segment times its weight: [S, 10] -> [S, N]."""
        return self.weight * np.log(self._densities(self._residuals(unknowns))[0])

    def weight_of_directions(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the weight of the segments that point to each vanishing point, vertical first: [10] -> [3]."""
        sine = self._residuals(unknowns[None]).sine[0] ** 2
        pairs = zip(self._precisions, self._peaks, strict=True)
        density = np.sum([np.exp(-0.5 * sine * precision) * peak for precision, peak in pairs], axis=0)  # [3, N]
        return density / (density.sum(0) + self._anywhere) @ self.weight

    def _residuals(self, unknowns: np.ndarray) -> AngleResiduals:
        return AngleResiduals(self._ends, unknowns, self._turn)

    def _of_segments(self, residuals: AngleResiduals) -> tuple[np.ndarray, np.ndarray]:
        """Returns the energy of the segments E [S], and the precision W [S, 3, N] in dE/dsine = W sine.

        W is the precision of each Gaussian times the probability that the segment comes from it (the E step of EM).
        """
        total, precision = self._densities(residuals)
        return -(self.weight * np.log(total)).sum(-1), precision * (self.weight / total)[:, None]

    def _densities(self, residuals: AngleResiduals) -> tuple[np.ndarray, np.ndarray]:
        """Densities of the mixture at each sine [S, N], and of its Gaussians times their precision [S, 3, N]."""
        exponent = residuals.sine**2 * -0.5
        density = precision = 0.0
        for each_precision, peak in zip(self._precisions, self._peaks, strict=True):
            part = np.exp(exponent * each_precision) * peak
            density = density + part
            precision = precision + part * each_precision
        return np.sum(density, 1) + self._anywhere, np.asarray(precision)


def _parts(segments: np.ndarray, aspect: float) -> np.ndarray:
    """Returns the part of the picture that contains each segment's centre, row by row from 0: [N, 4] -> [N]."""
    middle = (segments[:, :2] + segments[:, 2:]) / 2 / [aspect, 1] + 0.5
    column, row = np.clip((middle * _PARTS).astype(int), 0, _PARTS - 1).T
    return row * _PARTS + column


# ---- line segments of a photo ----------------------------------------------------------------------------

FEWEST_SEGMENTS = 8  # with fewer, a photo does not reveal how the camera moved
WIDEST_ASPECT = 2.5  # a little beyond what the network was trained on; beyond it, nothing was measured
_SCALE = 0.8  # LSD works on a copy scaled by this, to smooth the staircase of slanted edges
# LSD maps positions of its scaled copy back without regard to pixel centres; this is the correction.
_PIXEL_SHIFT = 0.5 / _SCALE - 0.5


def find_segments(grey: UInt8[np.ndarray, "height width"], limit: int | None = None) -> Float[np.ndarray, "segments 4"]:
    """Detects straight segments in a grey picture, longest first.

    Returns:
        [N, 4] end points (col1, row1, col2, row2) [px], pixel centres at integers, N may be 0.
    """
    with no_opencv_threads():  # LSD is serial, and idle threads cost time
        detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD, _SCALE)
        detected = detector.detect(np.ascontiguousarray(grey))[0]
    if detected is None:
        return np.zeros((0, 4))
    segments = detected.reshape(-1, 4).astype(np.float64) + _PIXEL_SHIFT
    length = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    return segments[np.argsort(-length, kind="stable")][:limit]


def in_rows(segments: Float[np.ndarray, "segments 4"], height: int, width: int) -> Float[np.ndarray, "segments 4"]:
    """Converts [N, 4] pixel positions in a picture of that size to centred units of rows."""
    center = np.array([(width - 1) / 2, (height - 1) / 2] * 2)
    return (segments - center) / height


def unusable(segments: Float[np.ndarray, "segments 4"], height: int, width: int) -> Reason | None:
    """Returns why the segments of a photo of that size cannot reveal its motion, or None if they may."""
    if max(width / height, height / width) > WIDEST_ASPECT:
        return Reason.of(Code.TOO_LONG, aspect=WIDEST_ASPECT)
    if len(segments) < FEWEST_SEGMENTS:
        return Reason.of(Code.TOO_FEW_SEGMENTS, segments=len(segments))
    return None


SHORT_SIDE = 768  # of the grey copy in which segments are detected [px]
MOST_ENLARGED = 2.0  # smaller photos are enlarged: LSD then finds more lines, more accurately
MOST_SEGMENTS = 320  # the longest are used

# Starting motions in addition to zero: t_x [rows] and r_z [rad] growing evenly to this at the last row
STARTS = [np.eye(6)[k] * size for k, size in ((0, 0.12), (0, -0.12), (3, 0.08), (3, -0.08))]


def segments_of(view: View, grey: np.ndarray | None = None) -> tuple[np.ndarray, tuple[int, int]]:
    """[N, 4] segments in centred units of rows, and (height, width) of the copy in which they were detected [px].

    Args:
        grey: the photo's grey copy, if it is at hand.
    """
    grey = view.grey(SHORT_SIDE) if grey is None else grey
    factor = min(SHORT_SIDE / min(view.height, view.width), MOST_ENLARGED)
    if factor > 1:
        size = (round(view.width * factor), round(view.height * factor))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC)
    return in_rows(find_segments(grey, MOST_SEGMENTS), *grey.shape), (grey.shape[0], grey.shape[1])


def likelihood_of(
    view: View,
    segments: np.ndarray,
    size: tuple[int, int],
    observation: NetworkObservation | None = None,
    kinds: Sequence[MotionKind] = (),
    params: PriorParams | None = None,
) -> ManhattanLikelihood:
    """Returns the likelihood of a photo's segments, with focal length, roll and tilt as far as known."""
    return ManhattanLikelihood(segments, size[0], size[1] / size[0], params, known_camera(view), observation, kinds)


def known_camera(view: View) -> KnownCamera:
    """Returns the known properties of the camera, from the user or the photo's metadata."""
    focal_px = view.known_focal_px()
    limit = view.speed_limit
    roll_deg, tilt_deg = view.attitude_deg()
    return KnownCamera(
        up=view.up,
        log_focal=math.log(focal_px / view.height) if focal_px else None,
        # a camera rotated clockwise sees the scene rotated counter-clockwise
        roll=None if roll_deg is None else -math.radians(roll_deg),
        tilt=None if tilt_deg is None else math.radians(tilt_deg),
        speed=None if limit is None else limit.precision(view.height),
    )
