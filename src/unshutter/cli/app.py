"""The application that the commands belong to, and the words they share."""

from typing import Literal

from cyclopts import App

from unshutter.version import __version__

ReadoutWord = Literal["auto", "top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]
Reference = Literal["first", "middle", "last"]

app = App(
    name="unshutter",
    version=__version__,
    help="Undoes rolling-shutter distortion (skew, wobble) in a single photo. Originals are never touched.",
)
