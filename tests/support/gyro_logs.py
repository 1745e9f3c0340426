"""Gyro logs of cameras whose motion the tests made, on a clock of their own and about axes of their own."""

import numpy as np

from unshutter.video.gyro.gyro_log import GRAVITY, GyroLog, Pair

# Device axes (columns) in the camera's (right, down, forward): x up, y back, z right.
AXES = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def gyro_log(camera, shift_s=0.0, bias=(0.0, 0.0, 0.0), noise=0.0, **more):
    """What a gyro in a RotatingCamera logs: its clock is ``shift_s`` ahead of the clip's, ``bias`` is shown at rest."""
    log = camera.log
    rates = np.stack([log.yaw_rad_s, log.roll_rad_s, log.pitch_rad_s], axis=-1) + bias
    rates = rates + np.random.default_rng(0).normal(0, noise, rates.shape)
    return GyroLog(log.t_s - camera.start_s + shift_s, rates, "a test", np.zeros((0, 4)), **more)


def as_pairs(tracks, fps=30.0):
    """Tracks between consecutive frames with their times."""
    return [Pair(each, k / fps, (k + 1) / fps) for k, each in enumerate(tracks)]


def write_gcsv(path, log, readout_ms=None, scale=1 / 3000):
    """Writes a log in Gyroflow's format, in whole units of the scale [rad/s]; without acceleration, up is one axis."""
    lines = ["GYROFLOW IMU LOG", "version,1.3", "id,test", "orientation,XYZ"]
    lines += ["tscale,0.000001", f"gscale,{scale!r}", "ascale,0.001"]
    lines += [] if readout_ms is None else [f"frame_readout_time,{readout_ms}"]
    lines += ["t,gx,gy,gz,ax,ay,az"]
    force = log.force[:, 1:] / GRAVITY if len(log.force) else np.tile([0.0, 1.0, 0.0], (len(log.t_s), 1))
    for time, rates, up in zip(log.t_s, log.rates, force, strict=True):
        words = [round(time * 1e6), *(round(rate / scale) for rate in rates), *(round(1000 * each) for each in up)]
        lines.append(",".join(map(str, words)))
    path.write_text("\n".join(lines) + "\n")
    return path
