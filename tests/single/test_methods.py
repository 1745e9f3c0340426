import json

import pytest

from unshutter.cli import main
from unshutter.options import DEFAULT_ESTIMATOR
from unshutter.single import Method, register
from unshutter.single.register import METHODS, describe_methods, names


def listed() -> list[str]:
    """Returns the rows of the table, without its head."""
    return describe_methods().partition("\n\n")[0].splitlines()[1:]


def test_every_estimator_is_listed_and_the_default_first():
    listed_names = [row.split()[0] for row in listed()]
    assert listed_names[0] == DEFAULT_ESTIMATOR
    assert set(listed_names) == set(names())
    assert all(method.summary and "\n" not in method.summary for method in METHODS)


def test_scores_are_those_of_the_results():
    for method in METHODS:
        assert method.scores is not None and method.name in json.loads(method.scores.read_text())


def test_the_table_says_what_was_measured_and_what_was_not(tmp_path, monkeypatch):
    weights, scores = tmp_path / "ours.npz", tmp_path / "scores.json"
    weights.write_bytes(bytes(1_840_000))
    scores.write_text(json.dumps({"ours": {"streets": {"epe_median": 1.234, "improved": 0.956}}}))
    ours = Method("ours", "does it", "m:C", weights=weights, scores=scores)
    monkeypatch.setattr(register, "METHODS", (ours, Method("theirs", "does, too", "m:C")))
    monkeypatch.setattr(register, "names", lambda: ["ours", "theirs"])
    first, *rows = describe_methods().splitlines()
    assert first.split() == ["name", "weights", "streets"]
    assert rows[0].split() == ["ours", "1.8", "MB", "1.23", "96", "%"]
    assert rows[1].split() == ["theirs", "-", "-"]
    assert rows[-1] == "theirs: does, too"


def test_the_command_prints_the_list(capsys: pytest.CaptureFixture[str]):
    assert main(["models"]) == 0
    assert DEFAULT_ESTIMATOR in capsys.readouterr().out
