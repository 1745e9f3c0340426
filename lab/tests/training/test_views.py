"""Another camera for every training window."""

import math

import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from unshutter.errors import UsageError
from unshutter_lab.training.variation import ViewConfig, draw_views, move, view_homography


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
