"""Damaged motion files, manifests, tables of points, names and networks of methods: clear errors or sense, no more.

UNSHUTTER_FUZZ_CASES=20000 python -m pytest tests/test_fuzz_texts.py
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.batches import make_motion, make_photos, rectify
from support.fuzzing import check, damaged, thorough
from unshutter import Motion, RotationMotion, RowMotion
from unshutter.export import PointTable
from unshutter.options import Rectify
from unshutter.run.job import Job
from unshutter.run.manifest import Manifest
from unshutter.single.register import check_name, method
from unshutter.storage.targets import Target

ODD = ["", "1e999", "1e308", "-1", "null", "[]", "{}", '"', "NaN", "9" * 400, "[" * 3000, '"last"', "true", "\x00"]
ODD += ["/", "..", "@", ",", ";", "\n", "\ufeff", "\\"]
ROWS = RowMotion.from_polynomials([0, 3, 1], [0, 0.01], 12, 16)
TURNS = RotationMotion(width=16, rotations=np.zeros((12, 3)), focal_px=20)
JPEG_FIRST = "x,y,name\n1,2,a\n3.5,4e1,b\n"


@st.composite
def changed(draw: st.DrawFn, texts: list[str]) -> bytes:
    """A text with something odd in it, or with bytes changed at random."""
    text = draw(st.sampled_from(texts))
    if draw(st.booleans()):
        return damaged(draw, text.encode())
    at = draw(st.integers(0, len(text)))
    until = draw(st.integers(at, min(at + 40, len(text))))
    return (text[:at] + draw(st.sampled_from(ODD) | st.text(max_size=20)) + text[until:]).encode("utf-8", "replace")


@pytest.fixture(scope="module")
def folder():
    with TemporaryDirectory() as name:
        yield Path(name)


@thorough
@given(changed([ROWS.to_json(), TURNS.to_json()]))
def test_damaged_motion_files(folder: Path, data: bytes) -> None:
    path = folder / "motion.json"
    path.write_bytes(data)
    motion = check(lambda: Motion.load(path))
    if isinstance(motion, RowMotion):
        assert np.isfinite(motion.tx_px).all()
        assert len(motion.tx_px) == motion.height


@pytest.fixture(scope="module")
def finished(folder: Path) -> tuple[Path, Job, str]:
    """A folder of results, one of its jobs, and its manifest's text."""
    make_photos(folder / "photos", ["a.jpg", "b.png"])
    motion = make_motion(folder / "good.json")
    assert rectify(folder / "photos", "-o", folder / "out", "--motion", motion) == 0
    job = Job(folder / "photos" / "a.jpg", (Target(folder / "out" / "a.rectified.jpg"),))
    return folder / "out", job, (folder / "out" / "unshutter-manifest.jsonl").read_text()


@thorough
@given(data=st.data())
def test_damaged_manifests(finished: tuple[Path, Job, str], data: st.DataObject) -> None:
    out, job, text = finished
    (out / "unshutter-manifest.jsonl").write_bytes(data.draw(changed([text])))

    def read() -> str:
        manifest = Manifest(out, Rectify(), read_only=True)
        state, prepared = manifest.compared(job)
        assert all(isinstance(target.left, (str, type(None))) for target in prepared.targets)
        return state

    assert check(read) in ("finished", "another's", "open", None)


@thorough
@given(changed([JPEG_FIRST, "1,2\n3,4\n", "id;x;y\n1;2;3\n", '"x","y"\n"1","2"\n']))
def test_damaged_tables_of_points(folder: Path, data: bytes) -> None:
    path = folder / "points.csv"
    path.write_bytes(data)
    check(lambda: PointTable.read(path))


@thorough
@given(changed(["segment-manhattan", "kandula2020@weights.onnx", "none@file", "rengarajan2017@/tmp/none.onnx"]))
def test_odd_names_of_methods(data: bytes) -> None:
    name = data.decode("utf-8", "surrogateescape")
    check(lambda: (check_name(name), method(name)))
