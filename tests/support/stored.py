"""Pictures as a sensor that is read in another direction would have stored them."""

import numpy as np

from unshutter import ScanDirection


def as_stored(frame: np.ndarray, readout: ScanDirection) -> np.ndarray:
    """Readout frame [H, W, ...] -> stored pixels."""
    return np.rot90(frame, -readout.quarter_turns)
