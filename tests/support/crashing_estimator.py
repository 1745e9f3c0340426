"""Estimators that behave as a broken decoder may: one takes its process down, the other never comes back."""

import os
import time

from unshutter import Estimator, Method, Motion, View

CRASHING = Method("crashing", "takes its process down", "support.crashing_estimator:Crashing")
HANGING = Method("hanging", "never comes back", "support.crashing_estimator:Hanging")


class Crashing(Estimator):
    """Takes its process down."""

    def estimate(self, view: View) -> Motion:
        os.abort()


class Hanging(Estimator):
    """Never comes back."""

    def estimate(self, view: View) -> Motion:
        time.sleep(600)
        raise AssertionError
