"""The residuals and their Jacobians: angles between rectified segments and the directions to three vanishing points.

For one hypothesis, an end point p of a segment, and u = row of p + 1/2:

    q = R(-r_z(u)) (p - (t_x(u), 0))                the end point rectified (paper, Eq. 1)
    d = q2 - q1,  m = (q1 + q2) / 2                 direction and centre of the rectified segment
    v = diag(f, f, 1) R_z(roll) R_x(tilt) w(yaw)    a vanishing point, homogeneous
    e = (v_x, v_y) - v_z m                          direction from the centre to the vanishing point
    a = arg(e) - arg(d)                             angle between expected and observed direction
    sin a = (d x e) / (|d| |e|)                     the residual, which does not distinguish a point from its antipode

``J_x`` is the derivative with respect to x of the value next to it. Shapes are [S, 3, N]: hypotheses, vanishing points
(vertical and two horizontal ones), segments.
"""

from __future__ import annotations

import numpy as np

from unshutter.estimators.right_angles.beliefs import LOG_FOCAL, MOTION, ROLL, TILT, UNKNOWNS, YAW

_DEGREES = np.arange(1, 4)
Vector = tuple[np.ndarray, ...]  # its components


class EndPoints:
    """One end of every segment, as observed.

    Args:
        points: [N, 2] (col, row), centred, in rows.
    """

    def __init__(self, points: np.ndarray):
        self.col, self.row = points[:, 0], points[:, 1]
        self.powers = (points[:, 1:] + 0.5) ** _DEGREES  # [N, 3] of u

    def rectified(self, motions: np.ndarray) -> RectifiedPoints:
        """Returns the points with S motions [S, 6] undone."""
        return RectifiedPoints(self.col, self.row, motions[:, 0:3] @ self.powers.T, motions[:, 3:6] @ self.powers.T)


class RectifiedPoints:
    """q = R(-r_z) (p - (t_x, 0)).

    Args:
        col, row: p, [N] each.
        tx, rz: [S, N] motion at these points.

    Attributes:
        col, row: q, [S, N] each.
    """

    def __init__(self, col: np.ndarray, row: np.ndarray, tx: np.ndarray, rz: np.ndarray):
        self._cos, self._sin = np.cos(rz), np.sin(rz)
        x = col - tx
        self.col, self.row = x * self._cos + row * self._sin, row * self._cos - x * self._sin

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
        unknowns: [S, 10] hypotheses.
        turn: roll [rad] of a camera held upright: a quarter turn if the scene lies on its side.

    Attributes:
        v: components x, y and z, [S, 3, 1] each.
    """

    def __init__(self, unknowns: np.ndarray, turn: float = 0.0):
        self._focal = np.exp(unknowns[:, LOG_FOCAL, None])
        self._roll, self._tilt, self._yaw = unknowns[:, ROLL] + turn, unknowns[:, TILT], unknowns[:, YAW]
        none, one = np.zeros_like(self._yaw), np.ones_like(self._yaw)
        cos, sin = np.cos(self._yaw), np.sin(self._yaw)
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
        cos, sin = np.cos(self._roll)[:, None], np.sin(self._roll)[:, None]
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
        cos, sin = np.cos(self._yaw), np.sin(self._yaw)
        return self._projected(*self._in_camera([none, -sin, -cos], [none, none, none], [none, cos, -sin]))

    def _in_camera(self, x: list, y: list, z: list) -> Vector:
        """Computes R_z R_x (x, y, z) for three directions, each component a list of arrays [S]: [S, 3] each."""
        right, down, ahead = (np.stack(a, -1) for a in (x, y, z))
        cos, sin = np.cos(self._tilt)[:, None], np.sin(self._tilt)[:, None]
        down, ahead = cos * down + sin * ahead, cos * ahead - sin * down
        cos, sin = np.cos(self._roll)[:, None], np.sin(self._roll)[:, None]
        return cos * right - sin * down, sin * right + cos * down, ahead

    def _projected(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Vector:
        """Computes diag(f, f, 1) (x, y, z): [S, 3] each -> [S, 3, 1] each."""
        return (self._focal * x)[..., None], (self._focal * y)[..., None], z[..., None]


class AngleResiduals:
    """The sine of a for every hypothesis, vanishing point and segment.

    Args:
        ends: both ends of every segment.
        unknowns: [S, 10] hypotheses.
        turn: see :class:`VanishingPoints`.

    Attributes:
        sine, cosine: of a, [S, 3, N].
    """

    def __init__(self, ends: tuple[EndPoints, EndPoints], unknowns: np.ndarray, turn: float = 0.0):
        motions = unknowns[:, MOTION]
        if (motions == motions[0]).all():  # one motion, many cameras: segments are rectified only once
            motions = motions[:1]
        self._ends = ends
        self._q = one, other = ends[0].rectified(motions), ends[1].rectified(motions)
        self._vanishing = VanishingPoints(unknowns, turn)
        self._d = dx, dy = other.col - one.col, other.row - one.row
        self._d2 = dx**2 + dy**2 + 1e-18
        self._m = (one.col + other.col)[:, None] / 2, (one.row + other.row)[:, None] / 2
        x, y, z = self._vanishing.v
        self._e = ex, ey = x - self._m[0] * z, y - self._m[1] * z
        self._e2 = ex**2 + ey**2 + 1e-12
        dx, dy = dx[:, None], dy[:, None]
        size = np.sqrt(self._e2 * self._d2[:, None])
        self.sine = (dx * ey - dy * ex) / size
        self.cosine = (dx * ex + dy * ey) / size

    def jacobian(self, camera_only: bool = False) -> np.ndarray:
        """Returns d sin a / d unknowns = cos a da/d unknowns, [S, 10, 3, N]; zero for the motion if ``camera_only``."""
        J = np.zeros((len(self.sine), UNKNOWNS, *self.sine.shape[1:]))
        if not camera_only:
            (one, other), powers = self._q, [end.powers.T for end in self._ends]
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
        (ex, ey), (mx, my) = self._e, self._m
        return (ex * (y - my * z) - ey * (x - mx * z)) / self._e2

    def _J_ends(self, J_q1: Vector, J_q2: Vector) -> tuple[np.ndarray, np.ndarray]:
        """Returns da/dx if only q1 depends on x, and if only q2 does.

        da/dx = (e x J_e) / |e|^2 - (d x J_d) / |d|^2 with J_e = -v_z J_q / 2, J_d = -J_q1 or J_q2.
        """
        (dx, dy), (ex, ey) = self._d, self._e
        half = self._vanishing.v[2] / (2 * self._e2)
        of_x, of_y = ey * half, ex * half
        J_1, J_2 = (
            of_x * x[:, None] - of_y * y[:, None] - (side * (dx * y - dy * x) / self._d2)[:, None]
            for (x, y), side in ((J_q1, -1), (J_q2, 1))
        )
        return J_1, J_2
