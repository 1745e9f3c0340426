"""An estimator that others brought along, and that is wrong."""

from unshutter import Estimator, Method, Motion, RowMotion, View

WRONG = Method("wrong", "puts in a shear that was not there", "support.wrong_estimator:Wrong")


class Wrong(Estimator):
    """Puts in a shear that was not there."""

    def estimate(self, view: View) -> Motion:
        return RowMotion.from_polynomials([0, 0.3 * view.width], [0], view.height, view.width)
