"""Other light, other cameras and their flaws for training pictures."""

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

import math

import pytest

from unshutter.errors import UsageError
from unshutter_lab.training.variation import (
    Light,
    LightConfig,
    ViewConfig,
    blur,
    compress,
    draw_views,
    move,
    view_homography,
)


def pictures(count: int = 4, size: int = 32) -> torch.Tensor:
    return torch.rand(count, 3, size, size, generator=torch.Generator().manual_seed(1)) * 0.8 + 0.1


def light(count: int = 4, seed: int = 0, **settings) -> Light:
    return Light(LightConfig(**{"share": 1.0, **settings}), torch.Generator().manual_seed(seed), count)


def test_without_a_share_nothing_changes():
    given = pictures()
    torch.testing.assert_close(light(share=0.0).on_scene(given.clone()), given)
    torch.testing.assert_close(light(share=0.0).through_camera(given.clone()), given)


def test_light_keeps_black_and_order():
    ramp = torch.linspace(0, 1, 32).expand(64, 3, 1, 32)
    seen = light(64, grey=0.0).on_scene(ramp.clone())
    assert (seen[..., 0] == 0).all() and (seen.diff(dim=-1) >= 0).all() and seen.max() <= 1
    assert seen[:, 0, 0, 16].std() > 0.05  # pictures differ
    assert (seen[:, 0, 0, 16] - seen[:, 1, 0, 16]).abs().mean() > 0.01  # channels too


def test_grey_pictures_have_equal_channels():
    seen = light(grey=1.0).on_scene(pictures())
    torch.testing.assert_close(seen[:, 0], seen[:, 2])


def test_blur_is_a_gaussian():
    point = torch.zeros(2, 1, 15, 15)
    point[..., 7, 7] = 1
    spread = blur(point, torch.tensor([1.0, 0.01]))
    torch.testing.assert_close(spread[1], point[1])
    places = torch.arange(15.0) - 7
    assert spread[0].sum().item() == pytest.approx(1, abs=1e-5)
    for along in (spread[0, 0].sum(0), spread[0, 0].sum(1)):
        assert (along * places.square()).sum().item() == pytest.approx(1, abs=0.05)


def test_compression_rounds_cosines_as_jpeg_does():
    given = pictures(2, 64)
    exact, coarse = compress(given, torch.tensor([1e-5, 0.5]))
    torch.testing.assert_close(exact, given[0], atol=1e-4, rtol=0)
    assert 0.02 < (coarse - given[1]).abs().mean() < 0.3
    flat = torch.full((1, 3, 16, 16), 0.4)
    assert compress(flat, torch.tensor([0.2])).std() < 1e-6  # a flat block stays flat
    block = given[0, 0, :8, :8].numpy()
    step = torch.tensor([0.3])
    steps = 0.3 * (1 + 5 * (np.arange(8)[:, None] + np.arange(8)) / 14) / 6
    expected = cv2.idct((np.round(cv2.dct(block) / steps) * steps).astype(np.float32))
    np.testing.assert_allclose(compress(given[:1, :1, :8, :8], step)[0, 0].numpy(), expected, atol=1e-4)


def test_noise_and_the_generator():
    grey = torch.full((16, 3, 16, 16), 0.5)
    settings = {"noisy": 1.0, "blurred": 0.0, "compressed": 0.0, "noise": 0.1}
    seen, again, other = (light(16, seed, **settings).through_camera(grey.clone()) for seed in (0, 0, 1))
    assert torch.equal(seen, again) and not torch.equal(seen, other)
    deviation = seen.flatten(1).std(1)
    assert deviation.max() < 0.11 and deviation.max() > 2 * deviation.min()


def test_bad_light():
    with pytest.raises(UsageError, match="shares"):
        LightConfig(noisy=-0.1)


def view(roll=0.0, tilt=0.0, yaw=0.0, zoom=1.0, place=(0.0, 0.0)):
    angles = [torch.tensor([math.radians(a)]) for a in (roll, tilt, yaw)]
    return view_homography(*angles, torch.tensor([400.0]), torch.tensor([zoom]), torch.tensor([place]))


def moved(homography, *points):
    col, row = torch.tensor([points]).unbind(-1)
    return torch.stack([a[0, 0] for a in move(homography, col[None], row[None])], -1)


def test_a_camera_that_stays_sees_the_window():
    torch.testing.assert_close(moved(view(), (3.0, 4.0), (-50.0, 7.0)), torch.tensor([[3.0, 4.0], [-50.0, 7.0]]))


def test_zoom_and_place():
    torch.testing.assert_close(moved(view(zoom=2.0, place=(10.0, -5.0)), (8.0, 6.0)), torch.tensor([[14.0, -2.0]]))


def test_roll_turns_the_picture_about_its_centre():
    # the camera turns clockwise by a quarter: what lay below is now to its right
    torch.testing.assert_close(moved(view(roll=90), (8.0, 0.0), (0.0, 0.0)), torch.tensor([[0.0, 8.0], [0.0, 0.0]]))


def test_looking_up_makes_verticals_converge_at_the_top():
    left, right = moved(view(tilt=10), (0.0, -100.0), (0.0, 100.0)).unbind()
    assert left[0] == right[0] == 0
    top, bottom = moved(view(tilt=10), (100.0, -100.0), (100.0, 100.0)).unbind()
    assert top[0] > 100 > bottom[0]  # the top of the picture shows more of the window


def test_looking_right_makes_horizontals_converge_on_the_right():
    left, right = moved(view(yaw=10), (-100.0, 100.0), (100.0, 100.0)).unbind()
    assert right[1] > 100 > left[1]


def test_cameras_vary_as_configured():
    config = ViewConfig(share=0.5)
    views = draw_views(config, torch.Generator().manual_seed(0), 2000, 256, 356)
    views = views / views[:, 2:, 2:]
    still = (views - torch.eye(3)).abs().amax((1, 2)) < 1e-4
    assert still.float().mean().item() == pytest.approx(0.5, abs=0.04)
    corners = torch.tensor([[-128.0, -128], [128, -128], [-128, 128], [128, 128]])
    col, row = move(views, corners[:, 0][None, None], corners[:, 1][None, None])
    inside = ((col.abs() < 178) & (row.abs() < 178)).all(-1).float().mean()
    assert inside > 0.97
    again = draw_views(config, torch.Generator().manual_seed(0), 2000, 256, 356)
    torch.testing.assert_close(views, again / again[:, 2:, 2:])


def test_bad_views():
    with pytest.raises(UsageError, match="shares"):
        ViewConfig(share=1.5)
    with pytest.raises(UsageError, match="zoom"):
        ViewConfig(zoom=0.5)
