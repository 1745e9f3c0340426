"""No process of ours talks to anybody but this computer."""

import os
import subprocess
import sys


def quiet_environment() -> dict[str, str]:
    """The environment without what the tests themselves switch off."""
    return {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}


def test_telemetry_is_off_before_onnxruntime_is_imported() -> None:
    """It is read once, when the library is loaded."""
    program = """
import importlib.abc, os, sys

class Watch(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "onnxruntime":
            print("telemetry off:", os.environ.get("ORT_DISABLE_TELEMETRY"))

sys.meta_path.insert(0, Watch())
import unshutter
unshutter.load("kandula2020").prepare()
"""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=quiet_environment(), capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["telemetry off: 1"]
