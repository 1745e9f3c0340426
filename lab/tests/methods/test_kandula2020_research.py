"""kandula2020-research on photos: what was trained is what runs, row map included."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")
nn = torch.nn

from unshutter_lab.methods.row_map import gs_to_rs_by_row_map
from unshutter_lab.training.config import TrainConfig
from unshutter_lab.training.kandula2020_recipe import KandulaRecipe
from unshutter_lab.training.pixels import draw_picture, rs_positions

torch.set_num_threads(1)
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """An untrained network whose row block says something, and its ONNX file."""
    torch.manual_seed(0)
    network_config = {"width": 4, "hidden": 16, "row_width": 4}
    data = {"drawn": 2, "held_out": 1}
    recipe = KandulaRecipe(TrainConfig("kandula2020", network=network_config, data=data), CPU)
    network = recipe.build()
    nn.init.normal_(network.row_block.layers[-1].weight, std=2.0)
    with torch.no_grad():  # about 30 px and 5 degrees
        network.motion_block.tx[-1].bias += torch.linspace(0.1, 1, 256)
        network.motion_block.rz[-1].bias += torch.linspace(0.02, 0.3, 256)
    path = tmp_path_factory.mktemp("onnx") / "model.onnx"
    recipe.export(network, path)
    return network.eval(), path


def test_the_estimator_runs_what_was_trained(exported):
    from unshutter.photo import Photo
    from unshutter.single.estimator import View
    from unshutter.single.register import load

    network, path = exported
    pixels = draw_picture(256, 7)
    with torch.no_grad():
        motion, row_map = network(torch.from_numpy(pixels)[None].float() / 255)
        expected = rs_positions(motion, row_map)
    estimator, view = (
        load(f"kandula2020-research@{path}"),
        View(Photo.from_array(np.ascontiguousarray(pixels.transpose(1, 2, 0)))),
    )
    found = estimator.estimate(view)
    np.testing.assert_allclose(found.tx_px, motion[0, 0] - motion[0, 0, 0], atol=1e-3)
    np.testing.assert_allclose(found.rz_rad, motion[0, 1] - motion[0, 1, 0], atol=1e-5)
    assert found.center_shift_px == pytest.approx(motion[0, 0, 0].item(), abs=1e-3)
    row, col = np.mgrid[0:256, 0:256]
    # the network's GS picture, seen from the first row's pose
    tx, rz = motion[0, :, 0].double().numpy()
    from_first = gs_to_rs_by_row_map(col, row, tx, rz, (127.5, 127.5))
    positions = found.gs_to_rs(*from_first)
    np.testing.assert_allclose(np.stack(positions), torch.cat(expected), atol=0.01)
    assert np.abs(row_map[0].numpy() - row).max() > 0.5
    plain = found.row_motion
    assert np.abs(plain.gs_to_rs(*from_first)[0] - positions[0]).max() > 0.1  # the row map matters
    again = found.rereferenced("last").rereferenced("first")
    np.testing.assert_allclose(again.gs_to_rs(col, row), found.gs_to_rs(col, row), atol=1e-9)


def test_what_runs_is_the_row_map(exported):
    import unshutter
    from unshutter.single.register import load

    estimator, pixels = (
        load(f"kandula2020-research@{exported[1]}"),
        np.ascontiguousarray(draw_picture(300, 7).transpose(1, 2, 0)),
    )
    motion = unshutter.estimate(pixels, estimator=estimator).motion
    plain = motion.row_motion
    by_row_map = unshutter.rectify(pixels, estimator=estimator, edges="keep").array
    assert np.array_equal(by_row_map, unshutter.rectify(pixels, motion=motion, edges="keep").array)
    assert not np.array_equal(by_row_map, unshutter.rectify(pixels, motion=plain, edges="keep").array)
    assert np.array_equal(pixels, unshutter.rectify(pixels, estimator=estimator, strength=0).array)
    saved = unshutter.Motion.from_json(motion.to_json())
    assert np.array_equal(by_row_map, unshutter.rectify(pixels, motion=saved, edges="keep").array)


def test_the_estimator_scales_to_the_photo(exported):
    from unshutter.photo import Photo
    from unshutter.single.estimator import View
    from unshutter.single.register import load

    estimator = load(f"kandula2020-research@{exported[1]}")
    small = np.ascontiguousarray(draw_picture(256, 7).transpose(1, 2, 0))
    large = np.pad(small.repeat(2, 0).repeat(2, 1), ((0, 0), (40, 40), (0, 0)))  # the square in the middle
    views = [View(Photo.from_array(p)) for p in (small, large)]
    motions = [estimator.estimate(v) for v in views]
    assert (motions[1].height, motions[1].width) == (512, 592)
    # row 2 i + 1/2 of the large picture is row i of the small one
    between = (motions[1].tx_px[1::2] + motions[1].tx_px[::2]) / 2
    np.testing.assert_allclose(np.diff(between), 2 * np.diff(motions[0].tx_px), atol=0.01)
    col, row = np.array([10.0, 200.0]), np.array([30.0, 240.0])
    x, y = motions[0].gs_to_rs(col, row)
    wide = motions[1].gs_to_rs(2 * col + 0.5 + 40, 2 * row + 0.5)
    # a quarter of a row lies between their first rows
    np.testing.assert_allclose(wide, (2 * x + 0.5 + 40, 2 * y + 0.5), atol=0.15)


@pytest.mark.parametrize("shape", [(300, 200), (70, 90, 4), (64, 64, 1)])
def test_the_estimator_takes_any_photo(exported, shape):
    from unshutter.options import Camera
    from unshutter.orientation import ScanDirection
    from unshutter.photo import Photo
    from unshutter.single.estimator import View
    from unshutter.single.register import load

    photo = Photo.from_array(np.full(shape, 40_000, np.uint16))
    found = load(f"kandula2020-research@{exported[1]}").estimate(View(photo, Camera("left-to-right")))
    assert (found.height, found.width) == (shape[1], shape[0]) and found.scan_direction == ScanDirection.LEFT_TO_RIGHT
