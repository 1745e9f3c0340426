"""Runs the command line for ``python -m unshutter``."""

from unshutter.cli import run

run()
