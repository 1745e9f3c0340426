"""Clips straightened by the command line."""

import json

import pytest

from unshutter.cli import main


@pytest.fixture
def straighten(tmp_path, capsys):
    """Straightens a clip; (the new file, the log's record, what was printed)."""

    def straightened(clip, *flags):
        out, log = tmp_path / f"out{clip.suffix}", tmp_path / "log.jsonl"
        words = ["video", clip, "-o", out, "--overwrite", "--json-log", log, *flags]
        assert main([*map(str, words)]) == 0
        return out, json.loads(log.read_text().splitlines()[-1]), capsys.readouterr().err

    return straightened
