"""unshutter-lab: synthesis, evaluation and training, and the paper's, its predecessor's and rival methods."""

from unshutter_lab.version import __version__

__all__ = ["__version__"]
