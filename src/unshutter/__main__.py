"""``python -m unshutter``."""

from unshutter.cli import run

run()
