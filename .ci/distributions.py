"""What the two distributions hold, and whether that is what they may hold.

    distributions.py DIST     # a folder with the wheels and source distributions of unshutter and unshutter-lab

Prints each wheel's folders with their sizes. Fails where the product's wheel is too large or contains research code or
weights that are not free, and where a licence is missing.
"""

from __future__ import annotations

import ast
import re
import sys
import tarfile
import zipfile
from collections import Counter
from email.parser import Parser
from pathlib import Path, PurePosixPath

LARGEST = 6_000_000  # bytes of the product's wheel
WEIGHTS = {  # free: trained and measured for unshutter, on drawn scenes and free pictures
    "calibration.json",
    "kandula2020.credits.csv",
    "kandula2020.log.csv",
    "kandula2020.md",
    "kandula2020.onnx",
    "scores.json",
    "segment-transformer.log.csv",
    "segment-transformer.md",
    "segment-transformer.npz",
}
RESEARCH = {"torch", "onnx", "sklearn", "unshutter_lab"}  # modules that no file of the product imports
TRAINED = (".npz", ".onnx", ".pt", ".pth", ".safetensors")
TERMS = {
    "unshutter": "Apache-2.0",
    "unshutter_lab": "Apache-2.0 AND CC0-1.0 AND LicenseRef-unshutter-research-weights",
}
PLACES, CREDITS = "unshutter_lab/places/", "CREDITS.md"  # pictures of the benchmark, and who made them
LARGEST_PLACES = 6_000_000  # bytes


def product_problems(wheel: zipfile.ZipFile) -> list[str]:
    """What is in the product's wheel and should not be, or the other way round."""
    names = wheel.namelist()
    weights = {PurePosixPath(name).name for name in names if name.startswith("unshutter/weights/")}
    problems = [f"unexpected weights: {name}" for name in sorted(weights ^ WEIGHTS)]
    for name in names:
        place = PurePosixPath(name)
        if _is_network_of_lab(place):
            problems.append(f"a network that is not the product's: {name}")
        if place.parts[0] != "unshutter" and not re.match(r"unshutter-[^/]+\.(dist-info|data)/", name):
            problems.append(f"not of the product: {name}")
        if place.suffix == ".py" and (imported := imports(wheel.read(name).decode()) & RESEARCH):
            problems.append(f"research code: {name} imports {', '.join(sorted(imported))}")
    return problems + licence_problems(wheel, "unshutter")


def lab_problems(wheel: zipfile.ZipFile) -> list[str]:
    """Networks of the laboratory's wheel without a card or terms, and licences that are missing."""
    networks = [PurePosixPath(name) for name in wheel.namelist() if name.endswith(TRAINED)]
    terms = [name for name in wheel.namelist() if re.search(r"\.dist-info/licenses/.*weights/LICENSE\.md$", name)]
    if not networks or not terms:
        return ["no networks, or no terms of them"]
    text = wheel.read(terms[0]).decode()
    problems = [f"no terms for {path.name}" for path in networks if path.name not in text]
    problems += [f"no card for {path}" for path in networks if str(path.with_suffix(".md")) not in wheel.namelist()]
    return problems + place_problems(wheel) + licence_problems(wheel, "unshutter_lab")


def place_problems(wheel: zipfile.ZipFile) -> list[str]:
    """Places that nobody is credited for, and too many of them."""
    inside = (each for each in wheel.infolist() if each.filename.startswith(PLACES))
    files = [each for each in inside if "/" in each.filename.removeprefix(PLACES)]
    if not files or PLACES + CREDITS not in wheel.namelist():
        return ["no places, or no credits for them"]
    text, size = wheel.read(PLACES + CREDITS).decode(), sum(each.file_size for each in files)
    names = sorted({each.filename.removeprefix(PLACES).partition("/")[0] for each in files})
    problems = [f"no credits for the place {name}" for name in names if f"| {name} |" not in text]
    return problems + ([f"places of {size:,} bytes"] if size > LARGEST_PLACES else [])


def licence_problems(wheel: zipfile.ZipFile, name: str) -> list[str]:
    """A wheel's licence in its metadata, and the files that it names."""
    (about,) = (each for each in wheel.namelist() if each.endswith(".dist-info/METADATA"))
    metadata = Parser().parsestr(wheel.read(about).decode())
    folder = about.removesuffix("METADATA") + "licenses/"
    files = metadata.get_all("License-File", [])
    problems = [f"no licence file {each}" for each in files if folder + each not in wheel.namelist()]
    if metadata["License-Expression"] != TERMS[name] or "LICENSE" not in files:
        problems.append(f"licence {metadata['License-Expression']} with the files {files}")
    return problems


def source_problems(names: list[str], is_product: bool) -> list[str]:
    """What is wrong with the files of a source distribution, named without its folder."""
    problems = [] if "LICENSE" in names else ["no LICENSE"]
    if is_product:
        foreign = [name for name in names if name.startswith("lab/") or _is_network_of_lab(PurePosixPath(name))]
        problems += [f"of the laboratory: {name}" for name in foreign]
    elif "src/unshutter_lab/weights/LICENSE.md" not in names:
        problems.append("no terms of the networks")
    return problems


def _is_network_of_lab(path: PurePosixPath) -> bool:
    return path.suffix in TRAINED and path.name not in WEIGHTS


def imports(code: str) -> set[str]:
    """The packages that code imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            found |= {each.name.partition(".")[0] for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


def show(path: Path, wheel: zipfile.ZipFile) -> None:
    """Prints the folders of a wheel, with the bytes that each adds to it."""
    sizes = Counter[str]()
    for each in wheel.infolist():
        sizes["/".join(each.filename.split("/")[:2])] += each.compress_size
    print(f"{path.name}: {path.stat().st_size:,} bytes")
    for name, size in sizes.most_common(12):
        print(f"  {size:>10,} {name}")


def main() -> None:
    folder = Path(sys.argv[1])
    problems = []
    for name, check in (("unshutter", product_problems), ("unshutter_lab", lab_problems)):
        (path,) = folder.glob(f"{name}-*.whl")
        with zipfile.ZipFile(path) as wheel:
            show(path, wheel)
            problems += [f"{path.name}: {each}" for each in check(wheel)]
        if name == "unshutter" and path.stat().st_size > LARGEST:
            problems.append(f"{path.name} has {path.stat().st_size:,} bytes, {LARGEST:,} are allowed")
        (path,) = folder.glob(f"{name}-*.tar.gz")
        with tarfile.open(path) as source:
            names = [each.partition("/")[2] for each in source.getnames()]
        problems += [f"{path.name}: {each}" for each in source_problems(names, name == "unshutter")]
    if problems:
        sys.exit("distributions: " + "\n".join(problems))


if __name__ == "__main__":
    main()
