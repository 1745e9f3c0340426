"""Products of cases: all of them where there is time, and few that have every value where there is not."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import pytest


def covering(*parameters: Sequence[Any]) -> list[Any]:
    """The product of the parameters' values, for ``pytest.mark.parametrize``.

    As many cases as the longest parameter has values run in ``make test``: in case k, each parameter has its k-th
    value, counted round, so that each value has its turn. The others are thorough.
    """
    longest = max(map(len, parameters))
    chosen = {tuple(k % len(values) for values in parameters) for k in range(longest)}
    return [
        pytest.param(
            *(values[k] for k, values in zip(places, parameters, strict=True)),
            marks=() if places in chosen else pytest.mark.thorough,
        )
        for places in product(*(range(len(values)) for values in parameters))
    ]


def thorough(*values: Any) -> Any:
    """A case that only ``make test-all`` runs, since another one has the same behaviour."""
    return pytest.param(*values, marks=pytest.mark.thorough)
