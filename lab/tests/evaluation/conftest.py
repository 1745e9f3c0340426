"""Photos to measure methods on, and what a plain run leaves."""

from pathlib import Path

import numpy as np
import pytest

from support.evaluations import run
from unshutter.photo import Photo
from unshutter_lab.evaluation import run as evaluation


@pytest.fixture(scope="session")
def photos(tmp_path_factory: pytest.TempPathFactory, facade: np.ndarray) -> Path:
    folder = tmp_path_factory.mktemp("data") / "houses"
    (folder / "more").mkdir(parents=True)
    Photo.from_array(facade[:300, :400]).save(folder / "a.png")
    Photo.from_array(facade[100:, 150:]).save(folder / "more" / "b.jpg")
    return folder


@pytest.fixture
def no_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out a run's plots, which take half of its time, for tests of something else."""
    monkeypatch.setattr(evaluation, "draw_plots", lambda results, folder: [])


@pytest.fixture(scope="session")
def measured(photos: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a plain run leaves; tests that change it copy it."""
    folder = tmp_path_factory.mktemp("measured")
    assert run(photos, folder) == 0
    return folder
