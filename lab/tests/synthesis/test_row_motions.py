import numpy as np
import pytest

from unshutter.errors import UnshutterError, UsageError
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import draw_from_trajectory, draw_quadratic


def save(path, **arrays):
    np.savez(path, **arrays)
    return path


def gyro_log(path, rate, seconds=10.0, hertz=200.0):
    """A log of constant rate (x, y, z)."""
    t = np.arange(int(seconds * hertz)) / hertz
    return save(path, t_s=t, gyro_rad_s=np.tile(np.asarray(rate, dtype=np.float32), (len(t), 1)))


# ---- quadratics -------------------------------------------------------------------------------------------


def test_quadratic_follows_the_predecessors_formula():
    drawn = draw_quadratic(np.random.default_rng(3))
    p = drawn.parameters
    for motion, first in ((drawn.canvas, 0), (drawn.crop, 50)):
        for k in (0, 17, motion.height - 1):
            i = first + k
            tx = p["alpha_tx"] * ((5 * i / 356) ** 2 - (250 / 356) ** 2) + p["beta_tx"] * 5 * (i - 50) / 356
            rz = (p["alpha_rz"] * (i**2 - 2500) / 356**2 + p["beta_rz"] * (i - 50) / 356) * np.pi / 8
            assert motion.tx_px[k] == pytest.approx(tx)
            assert motion.rz_rad[k] == pytest.approx(rz)
    assert (drawn.crop.height, drawn.crop.width, drawn.canvas.height, drawn.margin) == (256, 256, 356, 50)
    # both turn about the same place
    assert drawn.canvas.center == (drawn.crop.center[0] + 50, drawn.crop.center[1] + 50)


def test_quadratic_has_the_published_spread():
    """Facts of the predecessor's program over 20,000 draws: 26.9 and 59.8 px, 3.7 and 10.0 degrees."""
    rng = np.random.default_rng(0)
    crops = [draw_quadratic(rng).crop for _ in range(6000)]
    tx = np.array([np.abs(m.tx_px).max() for m in crops])
    rz = np.degrees([np.abs(m.rz_rad).max() for m in crops])
    assert np.mean(tx == 0) == pytest.approx(1 / 6, abs=0.02)  # pure rotation
    assert np.mean(rz == 0) == pytest.approx(1 / 6, abs=0.02)  # pure translation
    assert not ((tx == 0) & (rz == 0)).any()
    tx, rz = tx[tx > 0], rz[rz > 0]
    assert np.median(tx) == pytest.approx(26.9, rel=0.04)
    assert np.percentile(tx, 95) == pytest.approx(59.8, rel=0.03)
    assert np.median(rz) == pytest.approx(3.75, rel=0.04)
    assert np.percentile(rz, 95) == pytest.approx(10.0, rel=0.03)
    assert tx.max() < 75.1
    assert rz.max() < 12.9


def test_pure_rotation_can_be_left_out():
    rng = np.random.default_rng(0)
    crops = [draw_quadratic(rng, pure_rotation=False).crop for _ in range(300)]
    assert all(m.tx_px.any() for m in crops)
    assert any(not m.rz_rad.any() for m in crops)


def test_quadratic_of_another_size_is_the_same_motion_in_proportion():
    small = draw_quadratic(np.random.default_rng(5), 256, 356).crop
    large = draw_quadratic(np.random.default_rng(5), 512, 712).crop
    assert large.tx_px[::2] == pytest.approx(2 * small.tx_px)
    assert large.rz_rad[::2] == pytest.approx(small.rz_rad)


@pytest.mark.parametrize(("rows", "canvas"), [(256, 255), (256, 357), (1, 3)])
def test_sizes_that_do_not_fit(rows, canvas):
    with pytest.raises(UsageError, match="out of the middle of a canvas"):
        draw_quadratic(np.random.default_rng(0), rows, canvas)


@pytest.mark.parametrize("short_side", [300, 356, 480, 1001, 3000])
def test_native_size_keeps_proportions(short_side):
    drawn = draw_quadratic(np.random.default_rng(1))
    native = drawn.resized(short_side)
    n = round(256 * short_side / 356)
    assert native.crop.height == n
    assert native.canvas.height in (short_side, short_side - 1)
    assert (native.canvas.height - n) % 2 == 0
    assert (native.crop.tx_px[0], native.crop.rz_rad[0]) == (0, 0)
    assert np.array_equal(native.canvas.tx_px[native.margin :][:n], native.crop.tx_px)
    # row centres: native row k looks at row (k + .5) 256/n - .5 of the small crop, up to the reference row
    at = (np.arange(n) + 0.5) * 256 / n - 0.5 + 50
    tx = np.interp(at, np.arange(356), drawn.canvas.tx_px) * n / 256
    rz = np.interp(at, np.arange(356), drawn.canvas.rz_rad)
    assert native.crop.tx_px == pytest.approx(tx - tx[0], abs=1e-9)
    assert native.crop.rz_rad == pytest.approx(rz - rz[0], abs=1e-12)


# ---- trajectories -----------------------------------------------------------------------------------------


def test_gyro_axes_and_signs(tmp_path):
    """Phone, rear camera: about x (up in the picture) the camera turns left; about z counter-clockwise."""
    log = RotationLog.load(gyro_log(tmp_path / "log.npz", rate=(0.2, 5.0, -0.3)))
    crop = draw_from_trajectory(np.random.default_rng(0), log, readout_s=0.05, focal_px=400).crop
    turned = np.arange(256) * 0.05 / 256  # seconds since the first row
    assert crop.tx_px == pytest.approx(400 * np.tan(0.2 * turned), abs=1e-6)
    assert crop.rz_rad == pytest.approx(-0.3 * turned, abs=1e-8)


def test_poses_of_a_pan_equal_the_gyro_of_the_same_pan(tmp_path):
    """Turning about z at a rate that grows; the sign of a quaternion means nothing."""
    t = np.arange(600) / 120
    angle = 0.3 * t + 0.1 * t**2
    signs = np.where(np.arange(600) % 3 == 0, -1, 1)[:, None]
    q = np.stack([np.cos(angle / 2), 0 * t, 0 * t, np.sin(angle / 2)], axis=1) * signs
    log = RotationLog.load(save(tmp_path / "poses.npz", t_s=t, position_m=np.zeros((600, 3)), quaternion_wxyz=q))
    yaw, roll = log.angles(np.array([1.0, 2.5]))
    assert yaw[1] - yaw[0] == pytest.approx(0.3 * 1.5 + 0.1 * (2.5**2 - 1), abs=1e-6)
    assert roll == pytest.approx([0, 0], abs=1e-9)


def test_rates_of_a_tilted_camera_are_its_own(tmp_path):
    """A camera that hangs at any angle and turns about its own y rolls, whatever the world's axes."""
    from scipy.spatial.transform import Rotation

    t = np.arange(240) / 120
    start = Rotation.from_euler("xyz", [0.4, -1.1, 2.0])
    turns = start * Rotation.from_rotvec(np.outer(0.5 * t, [0, 1, 0]))
    q = turns.as_quat()[:, [3, 0, 1, 2]]
    log = RotationLog.load(save(tmp_path / "poses.npz", t_s=t, quaternion_wxyz=q))
    assert log.roll_rad_s == pytest.approx(np.full(239, 0.5), abs=1e-6)
    assert log.yaw_rad_s == pytest.approx(np.zeros(239), abs=1e-6)


def test_rates_are_integrated_exactly_between_samples(tmp_path):
    t = np.array([0.0, 1.0, 3.0])
    rate = np.array([[0.0, 0, 0], [0.2, 0, 0], [0.0, 0, 0]])
    log = RotationLog.load(save(tmp_path / "log.npz", t_s=t, gyro_rad_s=rate))
    assert log.angles(np.array([0, 0.5, 1.0, 2.0, 3.0]))[0] == pytest.approx([0, 0.025, 0.1, 0.25, 0.3])


def test_windows_never_cross_a_gap_and_reach_everywhere(tmp_path):
    t = np.concatenate([np.arange(100), np.arange(150, 350)]) / 100
    log = RotationLog.load(save(tmp_path / "log.npz", t_s=t, gyro_rad_s=np.zeros((300, 3))))
    rng = np.random.default_rng(0)
    starts = np.array([log.draw_start(rng, 0.3) for _ in range(2000)])
    assert (((starts >= 0) & (starts <= 0.69)) | ((starts >= 1.5) & (starts <= 3.19))).all()
    assert np.mean(starts < 1) == pytest.approx(0.69 / (0.69 + 1.69), abs=0.03)
    with pytest.raises(UnshutterError, match=r"2.5 s are needed, its longest stretch without a gap has 1.99 s"):
        log.draw_start(rng, 2.5)


def test_a_few_late_samples_are_put_in_order(tmp_path):
    t = np.arange(500) / 100
    rate = np.stack([t, 0 * t, 0 * t], axis=1)
    swapped = np.arange(500)
    swapped[[250, 251]] = swapped[[251, 250]]
    log = RotationLog.load(save(tmp_path / "log.npz", t_s=t[swapped], gyro_rad_s=rate[swapped]))
    assert log.t_s == pytest.approx(t)
    assert log.yaw_rad_s == pytest.approx(t)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"t_s": np.arange(9.0)}, "needs t_s and gyro_rad_s, or t_s and quaternion_wxyz"),
        ({"gyro_rad_s": np.zeros((9, 3))}, "needs t_s"),
        ({"t_s": np.arange(9.0)[::-1], "gyro_rad_s": np.zeros((9, 3))}, "do not increase"),
        ({"t_s": np.zeros(9), "gyro_rad_s": np.zeros((9, 3))}, "do not increase"),
        ({"t_s": np.arange(9.0), "gyro_rad_s": np.zeros((8, 3))}, "has shape"),
        ({"t_s": np.arange(9.0), "gyro_rad_s": np.zeros((9, 2))}, "has shape"),
        ({"t_s": np.arange(1.0), "gyro_rad_s": np.zeros((1, 3))}, "has shape"),
        ({"t_s": np.arange(9.0), "gyro_rad_s": np.full((9, 3), np.nan)}, "not finite"),
        ({"t_s": np.arange(9.0), "quaternion_wxyz": np.zeros((9, 4))}, "not rotations"),
        ({"t_s": np.array(["a", "b"]), "gyro_rad_s": np.zeros((2, 3))}, "not an NPZ file of numbers"),
        ({"t_s": np.array([{}, {}], dtype=object), "gyro_rad_s": np.zeros((2, 3))}, "not an NPZ file of numbers"),
    ],
)
def test_logs_that_cannot_be_used(tmp_path, arrays, message):
    path = tmp_path / "log.npz"
    np.savez(path, **arrays)
    with pytest.raises(UnshutterError, match=message) as caught:
        RotationLog.load(path)
    assert "log.npz" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_are_no_logs(tmp_path):
    with pytest.raises(UnshutterError, match="No such file"):
        RotationLog.load(tmp_path / "missing.npz")
    for name, data in (("text.npz", b"t_s, x, y, z\n"), ("empty.npz", b""), ("cut.npz", b"PK\x03\x04 broken")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(UnshutterError, match="not an NPZ file"):
            RotationLog.load(tmp_path / name)
    np.save(tmp_path / "array.npy", np.zeros(4))
    with pytest.raises(UnshutterError, match="not an NPZ file"):
        RotationLog.load(tmp_path / "array.npy")


def test_readouts_that_cannot_be(tmp_path):
    rng = np.random.default_rng(0)
    log = RotationLog.load(gyro_log(tmp_path / "log.npz", rate=(9.0, 0, 0), seconds=1))
    for readout_s, focal_px in ((0, 400), (-1, 400), (np.nan, 400), (0.03, 0), (0.03, np.inf)):
        with pytest.raises(UsageError, match="must be positive"):
            draw_from_trajectory(rng, log, readout_s, focal_px)
    with pytest.raises(UnshutterError, match="too short"):
        draw_from_trajectory(rng, log, 2.0, 400)
    with pytest.raises(UnshutterError, match="57 degrees"):
        draw_from_trajectory(rng, log, 0.5, 400)
