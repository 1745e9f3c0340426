"""What is known of methods without importing them, and methods that come from other packages."""

import os
import shutil
import subprocess
import sys
from importlib.metadata import EntryPoints
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.installed import install
from unshutter import Estimator, UnshutterError, UsageError, View
from unshutter.motion.finding import Finding
from unshutter.options import DEFAULT_ESTIMATOR
from unshutter.photo import Photo
from unshutter.single.register import METHODS, check_name, load, method, names

TILTED = """
from unshutter import Estimator, Method, Motion, RowMotion, View

TILTED = Method("tilted", "tells the tilt that it was told", "tilted:Tilted", grey_px=96)


class Tilted(Estimator):
    def estimate(self, view: View) -> Motion:
        assert view.grey(96).shape[0] == 96
        tilt = view.attitude_deg()[1]
        return RowMotion.from_polynomials([0, tilt], [0], view.height, view.width)
"""


def lines_of(command: list[str], folder: Path) -> subprocess.CompletedProcess:
    paths = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": paths}
    return subprocess.run(
        [sys.executable, "-m", "unshutter", *command], env=environment, capture_output=True, text=True
    )


def test_an_installed_package_adds_a_method(tmp_path: Path, rolling_facade: np.ndarray) -> None:
    (tmp_path / "tilted.py").write_text(TILTED)
    install(tmp_path, "tilted", {"tilted": "tilted:TILTED"})
    photo = tmp_path / "photo.png"
    Photo.from_array(rolling_facade).save(photo)
    done = lines_of(["estimate", str(photo), "--json", "--estimator", "tilted", "--tilt-deg", "7"], tmp_path)
    assert (done.returncode, done.stderr) == (0, f"{photo}: motion, points moved by up to 7.0 px\n")
    found = Finding.from_json(done.stdout)
    assert found.estimator == "tilted"
    assert found.motion.tx_px[-1] == pytest.approx(7)
    listed = lines_of(["models"], tmp_path)
    assert "tilted: tells the tilt that it was told" in listed.stdout.splitlines()
    refused = lines_of(["estimate", str(photo), "--estimator", "tiltd"], tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1 and "tilted" in refused.stderr


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("no_such_module:METHOD", "ModuleNotFoundError"),
        ("unshutter.options:NOTHING", "AttributeError"),
        ("unshutter.single.register:METHODS", "is not a Method of that name"),
        ("unshutter.single.register:method", "is not a Method of that name"),
        ("elsewhere_home:ELSEWHERE", "unshutter.errors:UsageError is not an Estimator"),
    ],
)
def test_a_broken_package_is_told_in_one_line(
    value: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = 'from unshutter import Method\nELSEWHERE = Method("elsewhere", "", "unshutter.errors:UsageError")\n'
    (tmp_path / "elsewhere_home.py").write_text(source)
    install(tmp_path, "elsewhere", {"elsewhere": value})
    monkeypatch.syspath_prepend(tmp_path)
    assert "elsewhere" in names()
    with pytest.raises(UnshutterError, match=told) as error:
        load("elsewhere")
    assert "'elsewhere'" in str(error.value) and "\n" not in str(error.value)


def test_a_method_of_the_package_cannot_be_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, "other", {"none": "nowhere:NONE"})
    monkeypatch.syspath_prepend(tmp_path)
    assert names().count("none") == 1
    assert method("none") in METHODS


def test_the_register_imports_little() -> None:
    """A photo is being decoded while methods are looked up; importlib.metadata alone takes longer than all the rest."""
    program = (
        "import sys; from unshutter.single.register import check_name, method; import unshutter.single;"
        f"check_name('{DEFAULT_ESTIMATOR}'); method('manhattan');"
        "print(*{'numpy', 'cv2', 'onnxruntime', 'pyvips', 'importlib.metadata'} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_methods_are_described() -> None:
    assert DEFAULT_ESTIMATOR in names()
    assert len({known.name for known in METHODS}) == len(METHODS)
    for known in METHODS:
        assert known.summary and "\n" not in known.summary
        assert known.weights is None or known.weights.is_file()
        assert known.takes_weights or known.weights is None


@pytest.mark.parametrize("name", names())
def test_every_method_keeps_the_contract(
    name: str, rolling_facade: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int | None] = []
    grey = View.grey
    monkeypatch.setattr(View, "grey", lambda view, short=None: asked.append(short) or grey(view, short))
    estimator = unshutter.load(name)
    assert isinstance(estimator, Estimator)
    assert estimator is unshutter.load(name)  # built once
    assert (estimator.name, estimator.method) == (name, method(name))
    estimator.prepare()
    found = Finding.of(estimator.estimate(View(Photo.from_array(rolling_facade))), name)
    assert (found.motion.height, found.motion.width) == rolling_facade.shape[:2]
    assert found.estimator == name
    assert found.motion.reference == "first"
    grey_px = method(name).grey_px  # what is decoded before the method is imported
    assert asked == ([] if grey_px is None else [grey_px])


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("magic", "unknown estimator 'magic': choose one of segment-transformer, "),
        ("magic@file.onnx", "unknown estimator 'magic'"),
        ("none@file.onnx", "accepts no other weights"),
    ],
)
def test_wrong_names_are_told_in_one_line(name: str, told: str) -> None:
    for refuse in (check_name, load):
        with pytest.raises(UsageError, match=told) as error:
            refuse(name)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("kandula2020-research", "choose one of .*, kandula2020, none; unshutter-lab adds more: "),
        ("kandula2021", r"did you mean kandula2020\?$"),
    ],
)
def test_a_method_of_the_laboratory_says_what_to_install(name: str, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unshutter.version.plugins", lambda group: EntryPoints())
    with pytest.raises(UsageError, match=told):
        load(name)


def test_weights_that_are_replaced_are_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, own = tmp_path / "own.npz", method("segment-transformer").weights
    assert own is not None
    shutil.copy(own, file)
    first = load(f"segment-transformer@{file}")
    monkeypatch.chdir(tmp_path)
    assert load("segment-transformer@own.npz") is first
    file.write_bytes(b"no weights")
    with pytest.raises(UnshutterError):
        load(f"segment-transformer@{file}")
