"""A motion as three numbers that people can read and set: how far it leans, bends and turns the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from unshutter.motion.geometry import RowMotion
from unshutter.motion.motion import Motion


@dataclass(frozen=True)
class Lean:
    """How far a motion leans, bends and turns what is upright in the picture."""

    lean_deg: float  # angle by which the change in t_x from the first row to the last slants vertical lines
    bend_percent: float  # deviation of t_x at the middle row from the line between those two, in % of the rows
    turn_deg: float  # r_z of the last row minus that of the first

    @classmethod
    def of(cls, motion: Motion) -> Lean:
        """Returns the numbers of a motion."""
        tx, rz, rows = motion.tx_px, motion.rz_rad, motion.height
        bend = (tx[(rows - 1) // 2] + tx[rows // 2]) / 2 - (tx[0] + tx[-1]) / 2
        lean_deg, turn_deg = (math.degrees(angle) for angle in (math.atan((tx[-1] - tx[0]) / rows), rz[-1] - rz[0]))
        return cls(lean_deg, 100 * float(bend) / rows, turn_deg)

    def given_to(self, motion: Motion) -> RowMotion:
        """Returns the motion changed to have these numbers; raises UnshutterError if it would fold the picture over."""
        now = Lean.of(motion)
        u = np.linspace(0, 1, motion.height)
        lean = math.tan(math.radians(self.lean_deg)) - math.tan(math.radians(now.lean_deg))
        bend, turn = self.bend_percent - now.bend_percent, self.turn_deg - now.turn_deg
        tx_px = motion.tx_px + motion.height * (lean * u + bend / 100 * 4 * u * (1 - u))
        rz_rad = motion.rz_rad + math.radians(turn) * u
        changed = RowMotion(motion.width, tx_px, rz_rad, scan_direction=motion.scan_direction)
        changed.check_unfolded()
        return changed
