"""An estimator that others brought along, and that is wrong."""

import unshutter
from unshutter import Motion, RowMotion


class Wrong:
    """Puts in a shear that was not there."""

    name = "wrong"

    def estimate(self, view: unshutter.estimators.View) -> Motion:
        return RowMotion.from_polynomials([0, 0.3 * view.width], [0], view.height, view.width)
