"""No process of ours talks to anybody but this computer."""

import os
from importlib.resources import files
from pathlib import Path

import pytest

from unshutter import UnshutterError
from unshutter.estimators.onnx import open_network


def quiet_environment() -> dict[str, str]:
    """The environment without what the tests themselves switch off."""
    return {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}


def test_telemetry_is_off_before_onnxruntime_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is read once, when the library is loaded."""
    monkeypatch.delenv("ORT_DISABLE_TELEMETRY")
    stand_in = "import os\nraise ImportError('telemetry off: ' + os.environ.get('ORT_DISABLE_TELEMETRY', 'no'))\n"
    (tmp_path / "onnxruntime.py").write_text(stand_in)
    monkeypatch.syspath_prepend(tmp_path)
    weights = files("unshutter") / "weights" / "kandula2020.onnx"
    with pytest.raises(UnshutterError, match="cannot load onnxruntime: telemetry off: 1"):
        open_network("kandula2020", Path(str(weights)), ["rs"], "motion")
