"""An estimator that can begin with a photo before its answer is wanted."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import lru_cache
from threading import Lock

from unshutter.errors import UnshutterError
from unshutter.estimators.base import Estimator, View
from unshutter.estimators.register import load
from unshutter.motion import Motion

_MOST_BEGUN = 2  # an answer that nobody asks for keeps its photo


class EstimatorAhead(Estimator):
    """Does what the estimator does, and begins where it is told to.

    Args:
        estimator: one that may be used by two threads at once.
    """

    def __init__(self, estimator: Estimator):
        super().__init__(estimator.method, estimator.weights)
        self._estimator = estimator
        self._begun: dict[View, Future[Motion]] = {}
        self._lock = Lock()  # one thread begins, another asks

    def prepare(self) -> None:
        """Does what can be done before there is a photo."""
        self._estimator.prepare()

    def begin(self, view: View, executor: Executor) -> None:
        """Lets the executor estimate; what goes wrong is told where the answer is asked for."""
        with self._lock:
            if view not in self._begun:
                while len(self._begun) >= _MOST_BEGUN:
                    del self._begun[next(iter(self._begun))]
                self._begun[view] = executor.submit(self._estimator.estimate, view)

    def estimate(self, view: View) -> Motion:
        """See :class:`Estimator`."""
        with self._lock:
            begun = self._begun.pop(view, None)
        if begun is not None:
            with suppress(UnshutterError):  # once more, for its message: libvips mixes those of two threads
                return begun.result()
        return self._estimator.estimate(view)


def of(name: str) -> EstimatorAhead:
    """The one about :func:`load`'s estimator of the name; raises what that does."""
    return _about(load(name))


@lru_cache(maxsize=4)
def _about(estimator: Estimator) -> EstimatorAhead:
    return EstimatorAhead(estimator)
