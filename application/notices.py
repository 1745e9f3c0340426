"""Adds the icon, and the licences of all bundled software, to the application's folder."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterable
from importlib import import_module
from importlib.metadata import Distribution, distributions
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / ".ci"))
licences = import_module("licences")

TOOLS = {
    *licences.TOOLS,
    "altgraph",
    "pyinstaller",
    "pyinstaller-hooks-contrib",
    "macholib",
    "pefile",
    "pywin32-ctypes",
}
LEFT_OUT = {"Pygments"}  # by the build
FONTS = ("DejaVuSans", "LastResort")  # of matplotlib's, which plots use
BROKEN_BY_STRIP = {"numpy.libs", "pyvips_binary.libs"}  # auditwheel changed their layout
TEXTS = ("licen", "copying", "notice", "authors", "sbom")
ABOUT = """What the application unshutter is made of

unshutter itself is under the Apache License 2.0 (licences/unshutter-*/). This folder also contains Python and the
packages below, each under its own licence; the folder `licences` has their texts.

As a whole, this folder is under the GNU General Public License, version 3 or later (licences/GPL-3.0.txt), and may be
passed on under its terms: the FFmpeg of the package av uses the encoders x264 and x265, which are under the GPL,
version 2 or later. The sources that belong to it:

    unshutter {version}: where you got this folder
    av {av}: https://github.com/PyAV-Org/PyAV
    its FFmpeg {ffmpeg}, x264, x265 and other libraries, as they were built for it: https://github.com/PyAV-Org/pyav-ffmpeg
    x264: https://code.videolan.org/videolan/x264
    x265: https://bitbucket.org/multicoreware/x265_git

Libraries under the LGPL (licences/LGPL-3.0.txt, and LGPL 2.1 in opencv-python-headless's LICENSE-3RD-PARTY.txt), among
them libvips, libheif, libde265, LibRaw and FFmpeg, are files of their own, which you may replace.

"""


def draw_icon(drawing: Path, icon: Path) -> None:
    """Draws the page's icon at 512 px."""
    import pyvips

    icon.parent.mkdir(parents=True, exist_ok=True)
    pyvips.Image.thumbnail(str(drawing), 512).write_to_file(str(icon))


def is_used(file: Path) -> bool:
    """Whether a file of data is of use: matplotlib has fonts and samples that plots of motions do not need."""
    if "mpl-data" not in file.parts:
        return True
    if "fonts" in file.parts:
        return file.name.startswith(FONTS) and "Display" not in file.name
    return "sample_data" not in file.parts


def write_notices(place: Path, binaries: Iterable[Path]) -> None:
    """Writes NOTICE.txt and the folder of licences; ``binaries`` are the libraries that were copied."""
    import av

    folder = place / "licences"
    shutil.copytree(HERE / "licences", folder)
    packages = sorted(
        (each for each in distributions() if each.name not in TOOLS | LEFT_OUT), key=lambda each: each.name.lower()
    )
    rows = [_copy_texts(package, folder) for package in packages]
    rows.append(_copy_python(folder))
    rows += _copy_system(binaries, folder)
    versions = {each.name: each.version for each in packages}
    about = ABOUT.format(version=versions["unshutter"], av=versions["av"], ffmpeg=av.ffmpeg_version_info)
    (place / "NOTICE.txt").write_text(about + "\n".join(rows) + "\n", encoding="utf-8")


def _copy_texts(package: Distribution, folder: Path) -> str:
    """Copies the licence files of a package; returns its line of the list."""
    files = [each for each in package.files or () if _is_text(each.parts)]
    target = folder / f"{package.name}-{package.version}"
    for file in files:
        target.mkdir(exist_ok=True)
        shutil.copy(str(package.locate_file(file)), target / file.name)
    carried = licences.carried(package)
    more = f"; carries {', '.join(carried)} (GPL)" if carried else ""
    missing = "" if files else " (its wheel has no text)"
    return f"{package.name} {package.version}: {licences.licence(package)}{more}{missing}"


def _is_text(parts: tuple[str, ...]) -> bool:
    """Whether a file of a package is a licence or a list of what was built into it."""
    inside = parts[0].endswith(".dist-info") and parts[-1] != "METADATA" and not parts[-1].endswith(".pyc")
    return inside and any(word in "/".join(parts[1:]).lower() for word in TEXTS)


def _copy_python(folder: Path) -> str:
    candidates = [Path(sysconfig.get_path("stdlib"), "LICENSE.txt"), Path(sys.base_prefix, "LICENSE.txt")]
    text = next((each for each in candidates if each.is_file()), None)
    if text is None:
        sys.exit("notices: Python's LICENSE.txt was not found")
    shutil.copy(text, folder / "Python.txt")
    return f"Python {sys.version.split()[0]}: PSF-2.0"


def _copy_system(binaries: Iterable[Path], folder: Path) -> list[str]:
    """Copies the licences of libraries that came from the system, as Debian and its relatives keep them."""
    rows = set()
    for library in binaries:
        if sys.platform != "linux" or not str(library.resolve()).startswith(("/lib/", "/usr/lib/")):
            continue
        names = [str(library.resolve()), str(library.resolve()).removeprefix("/usr")]
        asked = subprocess.run(["dpkg", "-S", *names], capture_output=True, text=True, check=False).stdout
        package = asked.partition(":")[0]
        text = Path("/usr/share/doc") / package / "copyright"
        if not package or not text.is_file():
            sys.exit(f"notices: no licence was found for {library}")
        shutil.copy(text, folder / f"{package}.txt")
        rows.add(f"{package}, of the system: see licences/{package}.txt")
    return sorted(rows)


def strip_symbols(place: Path) -> None:
    """Removes debug symbols, where that leaves libraries as they have to be."""
    for file in sorted(place.rglob("*")):
        if ".so" in file.name and not file.is_symlink() and BROKEN_BY_STRIP.isdisjoint(file.parts):
            subprocess.run(["strip", "--strip-unneeded", file], check=True)
