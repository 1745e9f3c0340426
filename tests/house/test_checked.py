"""That shapes in annotations are checked in the tests, and that nobody else pays for it."""

import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from support.checked import CHECKED, FOUND
from unshutter.motion.edges import valid_window
from unshutter.motion.geometry import gs_to_rs, rs_to_gs
from unshutter.motion.grid import Extent, SamplingGrid
from unshutter.motion.rotations import rotation_matrix


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_a_wrong_shape_is_seen(library) -> None:
    zeros = pytest.importorskip(library).zeros
    with pytest.raises(TypeCheckError, match="parameter 'rz'"):
        rs_to_gs(zeros((3, 1)), zeros((1, 4)), zeros((3, 4)), zeros(3))
    with pytest.raises(TypeCheckError, match="parameter 'vectors'"):
        rotation_matrix(zeros((5, 4)))
    assert rs_to_gs(zeros((3, 1)), zeros((1, 4)), 0.0, zeros(4))[0].shape == (3, 4)


def test_a_wrong_type_is_seen() -> None:
    with pytest.raises(TypeCheckError, match="parameter 'rz'"):
        rs_to_gs(np.arange(4), np.arange(4), 0.0, np.arange(4))
    with pytest.raises(TypeCheckError, match="parameter 'mask'"):
        valid_window(np.zeros((3, 4), np.uint8))


def test_a_wrong_result_is_seen() -> None:
    at = np.zeros((3, 4))
    assert gs_to_rs(at, at, lambda row: (at, at, at))[0].shape == (3, 4)  # of these shapes a call has passed
    with pytest.raises(TypeCheckError, match="return value"):
        gs_to_rs(at, at, lambda row: (np.zeros((2, 3, 4)), at, at))  # the columns come out larger than the rows


def test_methods_and_what_is_made_from_arrays_are_checked() -> None:
    with pytest.raises(TypeCheckError, match="parameter 'row'"):
        Extent.of(np.zeros((2, 3)), np.zeros((3, 2)))
    with pytest.raises(TypeCheckError, match="parameter 'nodes'"):
        SamplingGrid(np.zeros((2, 2, 2)), 1, 1, 2, 2)


@pytest.mark.parametrize("name", sorted(CHECKED))
def test_every_module_of_the_list_is_checked(name: str) -> None:
    import_module(name)
    assert FOUND[name]


def test_nothing_of_it_is_imported_otherwise() -> None:
    names = ["unshutter.api", *sorted(CHECKED)]
    checkers = {"beartype", "jaxtyping"}
    code = f"import sys, {', '.join(names)}; sys.exit(str({checkers} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == "set()"
