import json

import pytest

from unshutter.cli import main
from unshutter.estimators.catalogue import Listed, as_text, list_models
from unshutter.estimators.method import Method
from unshutter.estimators.register import names
from unshutter.options import DEFAULT_ESTIMATOR


def test_every_estimator_is_listed_and_the_default_first():
    models = list_models()
    assert models[0].method.name == DEFAULT_ESTIMATOR
    assert {m.method.name for m in models} == set(names())
    assert all(m.method.summary and "\n" not in m.method.summary for m in models)


def test_sizes_are_those_of_the_files():
    for model in list_models():
        path = model.method.weights
        assert model.weights_mb == pytest.approx(len(path.read_bytes()) / 1e6 if path else 0)


def test_scores_are_those_of_the_results():
    for model in list_models():
        path = model.method.scores
        measured = json.loads(path.read_text()) if path else {}
        assert set(model.scores) == set(measured.get(model.method.name, {}))
    assert models_with_scores() >= {"segment-manhattan", "manhattan", "none"}


def models_with_scores() -> set[str]:
    return {model.method.name for model in list_models() if model.scores}


def test_the_table_says_what_was_measured_and_what_was_not():
    text = as_text(
        [
            Listed(Method("ours", "does it", "m:C"), 1.84, {"streets": (1.234, 0.956)}),
            Listed(Method("theirs", "does, too", "m:C"), 0, {}),
        ]
    )
    first, ours, theirs, *_ = text.splitlines()
    assert first.split() == ["name", "weights", "streets"]
    assert ours.split() == ["ours", "1.8", "MB", "1.23", "96", "%"]
    assert theirs.split() == ["theirs", "-", "-"]


def test_the_command_prints_the_list(capsys):
    assert main(["models"]) == 0
    assert DEFAULT_ESTIMATOR in capsys.readouterr().out
