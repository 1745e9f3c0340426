"""Packages of others, as pip would have installed them: what they offer by entry points."""

from pathlib import Path


def install(folder: Path, name: str, estimators: dict[str, str]) -> None:
    """Puts a package's metadata into a folder of sys.path.

    Args:
        folder: where.
        name: of the package.
        estimators: entry points of the group ``unshutter.estimators``: name -> ``module:object``.
    """
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"{estimator} = {value}" for estimator, value in estimators.items()]
    (info / "entry_points.txt").write_text("\n".join(["[unshutter.estimators]", *lines, ""]))
