"""`make` leaves the environment alone that README.md tells users to create."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_no_target_touches_the_environment_of_the_user() -> None:
    users = set(re.findall(r"python3 -m venv (\S+)", (ROOT / "README.md").read_text(encoding="utf-8")))
    assert users == {".venv"}
    targets = ["demo", "paper", "test", "test-newest", "test-lowest", "docs", "app", "clean"]
    outside = {name: value for name, value in os.environ.items() if "MAKE" not in name and name != "PYTHON"}
    dry_run = ["make", "-n", "-B", *targets]
    printed = subprocess.run(dry_run, cwd=ROOT, env=outside, capture_output=True, text=True, check=True).stdout
    environments = set(re.findall(r"\.venv[^\s/]*", printed))
    assert environments >= {".venv-dev", ".venv-newest", ".venv-lowest", ".venv-app"}
    assert not environments & users
