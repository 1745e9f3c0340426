"""Pictures that the tests draw for themselves."""

import cv2
import numpy as np
import pytest

from unshutter import Motion


def draw_facade(height: int = 420, width: int = 560) -> np.ndarray:
    """A house front with windows, seen straight on: uint8 RGB."""
    big = np.full((2 * height, 2 * width, 3), 215, np.uint8)
    cv2.rectangle(big, (0, 0), (2 * width, height // 3), (150, 180, 220), -1)  # sky
    left, right, top = width // 5, 2 * width - width // 5, height // 4
    cv2.rectangle(big, (left, top), (right, 2 * height - 60), (180, 150, 120), -1)
    for row in np.linspace(top + 50, 2 * height - 260, 4).astype(int):
        for col in np.linspace(left + 40, right - 140, 6).astype(int):
            cv2.rectangle(big, (col, row), (col + 90, row + 120), (60, 70, 90), -1)
            cv2.rectangle(big, (col, row), (col + 90, row + 120), (235, 235, 230), 6)
            cv2.line(big, (col + 45, row), (col + 45, row + 120), (235, 235, 230), 5)
    noise = np.random.default_rng(0).normal(0, 4, (height, width, 3))
    small = cv2.resize(big, (width, height), interpolation=cv2.INTER_AREA)
    return np.clip(small + noise, 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def facade() -> np.ndarray:
    return draw_facade()


@pytest.fixture(scope="session")
def facade_motion(facade: np.ndarray) -> Motion:
    return Motion.from_polynomials([0, 50, -90], [0, 0.05], *facade.shape[:2])


@pytest.fixture(scope="session")
def rolling_facade(facade: np.ndarray, facade_motion: Motion) -> np.ndarray:
    """The facade as a rolling shutter would have taken it."""
    from unshutter.photo import Photo
    from unshutter.warp import distort_image

    photo = Photo.from_array(facade)
    return photo.with_image(distort_image(photo.image, facade_motion)).to_array()
