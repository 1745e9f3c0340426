"""What C libraries print by themselves is kept back, and nothing else."""

import os
from concurrent.futures import ThreadPoolExecutor

import pytest

from unshutter.photo.formats.raw import kept_back


def test_matching_lines_go_and_others_come_afterwards(capfd: pytest.CaptureFixture[str]) -> None:
    with kept_back(b"file: (cut|bent)"):
        os.write(2, b"file: cut\nnot a file: cut\n")
        os.write(2, b"a message\n")
        os.write(2, b"file: bent\n")
    os.write(2, b"the end\n")
    assert capfd.readouterr().err == "not a file: cut\na message\nthe end\n"


def test_after_an_error_and_from_several_threads(capfd: pytest.CaptureFixture[str]) -> None:
    def fail(number: int) -> None:
        with pytest.raises(ZeroDivisionError), kept_back(b"stray"):
            os.write(2, b"stray\n%d\n" % number)
            raise ZeroDivisionError

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(fail, range(20)))
    os.write(2, b"stray\n")
    lines = capfd.readouterr().err.splitlines()
    assert sorted(lines[:-1], key=int) == [str(number) for number in range(20)] and lines[-1] == "stray"
