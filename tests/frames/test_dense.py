import numpy as np
import pytest

from unshutter.frames.flow import Field, Flow, field_between, joined, pixel_grid
from unshutter.frames.frame_motion import Timing

HEIGHT, WIDTH = 40, 60
BLANK = np.zeros((HEIGHT, WIDTH), np.uint8)


def constant(across, down):
    return np.broadcast_to(np.array([across, down], np.float32), (HEIGHT, WIDTH, 2)).copy()


def field(velocity, moment=0.3, ratio=0.9, cost=0.0):
    costs = np.full((HEIGHT, WIDTH), cost, np.float32)
    return Field(constant(*velocity), 0.0, moment, Timing(ratio, HEIGHT), costs, costs)


@pytest.mark.parametrize("moment", [0.0, 0.45, 1.2])
@pytest.mark.parametrize("ratio", [0.3, 1.0])
def test_content_that_moves_at_one_speed(ratio, moment) -> None:
    # a point that moves v px a frame interval and is seen by rows that are read meanwhile: v = F / (1 + ratio F_y / H)
    velocity = np.array([7.0, 5.0])
    there = velocity / (1 - ratio * velocity[1] / HEIGHT)
    flow = Flow(constant(*there), constant(*-there), np.array([[1, 0, there[0]], [0, 1, there[1]], [0, 0, 1]]), 1.0)
    answer = field_between(BLANK, BLANK, flow, Timing(ratio, HEIGHT), moment)
    np.testing.assert_allclose(answer.velocity, constant(*velocity), rtol=1e-4)


@pytest.mark.parametrize("frame", [-1, 0, 1])
def test_it_looks_where_the_frame_saw_the_content(frame) -> None:
    motion = field((6.0, -4.0))
    position = pixel_grid(HEIGHT, WIDTH) + motion.shift(frame)
    moments = motion.timing.exposed(frame, position[..., 1:])
    np.testing.assert_allclose(position, pixel_grid(HEIGHT, WIDTH) + [6.0, -4.0] * (moments - 0.3), atol=1e-3)


def test_two_neighbours_give_a_speed_that_changes() -> None:
    # x = 10 t + 4 t^2 / 2, seen at row 20 of frame 0 (t = 0.45): mean speeds of the frame intervals before and after
    moment, row = 0.45, 20
    before, after = field((10 + 4 * (0.45 - 0.5), 0.0), moment), field((10 + 4 * (0.45 + 0.5), 0.0), moment)
    both = joined(before, after)
    np.testing.assert_allclose(both.velocity[row, :, 0], 10 + 4 * moment, atol=1e-4)
    np.testing.assert_allclose(both.acceleration[row, :, 0], 4, atol=1e-4)
    # a whole frame interval later it is 10 + 4 * 0.45 + 4 / 2 px on
    np.testing.assert_allclose(both.shift(1)[row, :, 0], 10 + 4 * 0.45 + 2, atol=1e-3)


def test_the_neighbour_that_explains_nothing_is_left_out() -> None:
    both = joined(field((5.0, 0.0), cost=1.0), field((90.0, 0.0), cost=40.0))
    np.testing.assert_allclose(both.velocity[..., 0], 5, atol=1e-3)
