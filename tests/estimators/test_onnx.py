from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from unshutter.cli import main
from unshutter.photo import Photo


@pytest.mark.parametrize("name", ["segment-transformer", "segment-manhattan", "kandula2020", "rengarajan2017"])
def test_weights_that_are_none_are_told_in_one_line(
    name: str, tmp_path: Path, rolling_facade: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, text = tmp_path / "photo.png", tmp_path / "text.onnx"
    Photo.from_array(rolling_facade).save(photo)
    text.write_text("no network")
    other = files("unshutter") / "weights" / ("segment-transformer.onnx" if "20" in name else "kandula2020.onnx")
    for command in (["rectify", str(photo), "-o", str(tmp_path / "out.png")], ["estimate", str(photo)]):
        for weights, told in ((text, "PROTOBUF"), (other, "they are not of")):
            assert main([*command, "--estimator", f"{name}@{weights}"]) == 1
            message = capsys.readouterr().err
            assert message.count("\n") == 1 and "cannot use the weights" in message and told in message
    assert not (tmp_path / "out.png").exists()
