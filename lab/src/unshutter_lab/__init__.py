"""unshutter-lab: synthesis, evaluation and training, and the methods of the paper, its predecessor and rivals."""

from unshutter_lab.version import __version__

__all__ = ["__version__"]
