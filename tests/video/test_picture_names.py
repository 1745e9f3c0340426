"""Names of numbered pictures in a folder."""

from pathlib import Path

import pytest

from unshutter.errors import UnshutterError
from unshutter.video.pictures import PictureSequence


def _folder(tmp_path: Path, names: list[str]) -> Path:
    for name in [*names, "notes.txt"]:
        (tmp_path / name).write_bytes(b"")
    return tmp_path


@pytest.mark.parametrize(
    ("names", "pattern", "first"),
    [
        (["0001.png", "0002.png"], "%04d.png", 1),
        (["f-8.jpg", "f-9.jpg", "f-10.jpg"], "f-%01d.jpg", 8),  # as many programs number them
        (["9999.png", "10000.png"], "%04d.png", 9999),
    ],
)
def test_a_folder_of_one_sequence(tmp_path: Path, names: list[str], pattern: str, first: int) -> None:
    found = PictureSequence.at(str(_folder(tmp_path, names)))
    assert found is not None and found.pattern == f"{tmp_path}/{pattern}" and found.first == first


@pytest.mark.parametrize("names", [["a1.png", "b1.png"], ["1.png", "2.jpg"], ["001.png", "0002.png"]])
def test_a_folder_of_several(tmp_path: Path, names: list[str]) -> None:
    with pytest.raises(UnshutterError, match=r"several kinds of numbered pictures.* such as .*/a?%0[13]d\.(png|jpg)"):
        PictureSequence.at(str(_folder(tmp_path, names)))
