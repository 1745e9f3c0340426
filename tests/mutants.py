"""Changes the product's code in random places, one at a time, and says which changes no test notices.

    python tests/mutants.py --seed 1 --count 60          # by the tests of `make test`
    python tests/mutants.py --seed 1 --count 60 --all    # by those of `make test-all`
    python tests/mutants.py --seed 1 --only 7 23         # two of them again

Of each change, the tests of its room run first, then those that name its module, then all others, until one fails. The
code is changed in a copy, which the tests import through PYTHONPATH.
"""

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "unshutter"
LONGEST_S = 3600  # of one round of tests: a change that makes a loop endless is noticed, too
OPERATORS: dict[type, tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"),
    ast.Pow: ("**", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}


@dataclass(frozen=True)
class Mutant:
    """A change of one operator, constant or branch.

    Attributes:
        file: in the package.
        line: counted from 1.
        start: of what is replaced: bytes from the start of the file.
        old: what stands there.
        new: what replaces it.
    """

    file: Path
    line: int
    start: int
    old: str
    new: str

    @property
    def room(self) -> str:
        return self.file.parts[0].removesuffix(".py")

    def apply(self, source: bytes) -> bytes:
        end = self.start + len(self.old.encode())
        assert source[self.start : end] == self.old.encode()
        return source[: self.start] + self.new.encode() + source[end:]

    def __str__(self) -> str:
        return f"{self.file.as_posix()}:{self.line}: {self.old} -> {self.new}"


# ---- what can be changed -----------------------------------------------------------------------------------------


class Finder(ast.NodeVisitor):
    """Finds the places of a file where something can be changed: neither in annotations nor in decorators."""

    def __init__(self, file: Path, source: bytes):
        self.file, self.source, self.found = file, source, list[Mutant]()
        self._starts = [0]
        for line in source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def _span(self, node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None and node.end_col_offset is not None
        return self._starts[node.lineno - 1] + node.col_offset, self._starts[node.end_lineno - 1] + node.end_col_offset

    def _add(self, start: int, old: str, new: str) -> None:
        self.found.append(Mutant(self.file, self.source.count(b"\n", 0, start) + 1, start, old, new))

    def _replace_operator(self, left: ast.expr, operator: ast.AST, right: ast.expr) -> None:
        """Replaces an operator between two operands, outside of which are only brackets, blanks and comments."""
        if type(operator) not in OPERATORS:
            return
        old, new = OPERATORS[type(operator)]
        start, end = self._span(left)[1], self._span(right)[0]
        between = self.source[start:end]
        if b"#" not in between and (match := re.search(re.escape(old.encode()), between)):
            self._add(start + match.start(), old, new)

    def _replace(self, node: ast.expr, new: str) -> None:
        start, end = self._span(node)
        self._add(start, self.source[start:end].decode(), new)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        self._replace_operator(node.left, node.op, node.right)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._replace_operator(left, node.op, right)
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        operands = [node.left, *node.comparators]
        for left, operator, right in zip(operands, node.ops, operands[1:], strict=False):
            self._replace_operator(left, operator, right)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.Not):
            self._replace(node, self.source[slice(*self._span(node.operand))].decode())
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool):
            self._replace(node, str(not node.value))
        elif isinstance(node.value, int):
            self._replace(node, str(node.value + 1))
        elif isinstance(node.value, float):
            self._replace(node, repr(2 * node.value if node.value else 1.0))

    def visit_If(self, node: ast.If) -> None:
        if not (isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"):
            self._turn(node.test)
            self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._turn(node.test)
        self.generic_visit(node)

    def _turn(self, test: ast.expr) -> None:
        text = self.source[slice(*self._span(test))].decode()
        self._replace(test, f"(not ({text}))")

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        for each in [*node.args.defaults, *filter(None, node.args.kw_defaults), *node.body]:
            self.visit(each)

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for each in node.body:
            self.visit(each)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg != "strict":  # of zip: it only says what is true already
            self.visit(node.value)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Passes over what is in an f-string: before Python 3.12, its places are not known."""


@cache
def places(file: Path) -> list[Mutant]:
    finder = Finder(file, (SOURCE / file).read_bytes())
    finder.visit(ast.parse(finder.source))
    return finder.found


def draw(seed: int, count: int) -> list[Mutant]:
    """Changes drawn at random: a room, one room after the other; in it a file, by its size; in that a place."""
    chance = random.Random(seed)
    rooms: dict[str, list[Path]] = {}
    for path in sorted(SOURCE.rglob("*.py")):
        file = path.relative_to(SOURCE)
        rooms.setdefault(file.parts[0] if len(file.parts) > 1 else "", []).append(file)
    drawn: list[Mutant] = []
    while len(drawn) < count:
        for room in chance.sample(sorted(rooms), len(rooms))[: count - len(drawn)]:
            sizes = [(SOURCE / file).stat().st_size for file in rooms[room]]
            found = places(chance.choices(rooms[room], sizes)[0])
            if found and (mutant := chance.choice(found)) not in drawn:
                drawn.append(mutant)
    return drawn


# ---- what notices it ---------------------------------------------------------------------------------------------


def rounds(mutant: Mutant, last: str) -> Iterator[tuple[str, list[str]]]:
    """What is tried one after the other until the last round: its name, and the files of its tests."""
    tests = [path for folder in ("tests", "lab/tests") for path in sorted((ROOT / folder).rglob("test_*.py"))]
    # what the house looks like is no behaviour
    tests = [path for path in tests if "house" not in path.parts]
    module = mutant.file.with_suffix("").name
    text = {path: path.read_text(encoding="utf-8") for path in tests}
    own = [path for path in tests if re.search(rf"\b{re.escape(module)}\b", text[path])]
    same = [path for path in own if mutant.room in path.relative_to(ROOT).parts]
    room = [path for path in tests if mutant.room in path.relative_to(ROOT).parts]
    done: set[Path] = set()
    for name, files in (("its file", same), ("its room", room), ("its name", own), ("the rest", tests)):
        left = [path for path in files if path not in done]
        done |= set(left)
        if left:
            yield name, [str(path.relative_to(ROOT)) for path in left]
        if name == last:
            return


class Trial:
    """Runs tests on a changed copy of the package.

    Args:
        folder: where the copy is made.
        options: of pytest.
    """

    def __init__(self, folder: Path, options: list[str]):
        self._package, self._options = folder / "src" / "unshutter", options
        self._broken: list[str] = []  # tests that fail without any change
        shutil.copytree(SOURCE, self._package, ignore=shutil.ignore_patterns("__pycache__"))

    def notice(self, mutant: Mutant, last: str) -> str:
        """The first test that fails because of a change, or nothing."""
        original = (SOURCE / mutant.file).read_bytes()
        for name, files in rounds(mutant, last):
            while True:
                (self._package / mutant.file).write_bytes(mutant.apply(original))
                failed = self._failed(files)
                (self._package / mutant.file).write_bytes(original)
                if not failed or "::" not in failed or not self._failed([failed]):
                    break
                self._broken.append(failed)
            if failed:
                return f"{name}: {failed}"
        return ""

    def _failed(self, tests: list[str]) -> str:
        """The first test that fails, or how else pytest ends; nothing if all pass."""
        paths = str(self._package.parent), os.environ.get("PYTHONPATH")
        environment = {"PYTHONPATH": os.pathsep.join(filter(None, paths)), "PYTHONDONTWRITEBYTECODE": "1"}
        without = [word for test in self._broken for word in ("--deselect", test)]
        words = [sys.executable, "-m", "pytest", "-x", "--tb=no", "-p", "no:cacheprovider", *self._options, *without]
        try:
            done = subprocess.run(
                [*words, *tests],
                cwd=ROOT,
                env=os.environ | environment,
                capture_output=True,
                text=True,
                timeout=LONGEST_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return f"takes more than {LONGEST_S} s"
        if done.returncode in (0, 5):  # 5: no test was chosen
            return ""
        found = re.search(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", done.stdout, re.MULTILINE)
        return found[1] if found else (done.stdout + done.stderr)[-200:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--only", type=int, nargs="*", help="numbers in the list, from 1")
    parser.add_argument("--all", action="store_true", help="with the thorough tests")
    parser.add_argument("--last", default="the rest", help='the last round: "its file", "its room", "its name"')
    parser.add_argument("--list", action="store_true", help="print what would be changed, and end")
    parser.add_argument("--workers", default="0", help="processes of pytest-xdist")
    asked = parser.parse_args()
    drawn = draw(asked.seed, asked.count)
    options = ["-n", asked.workers, *(["--all"] if asked.all else [])]
    noticed = tried = 0
    with tempfile.TemporaryDirectory() as folder:
        trial = Trial(Path(folder), options)
        for number, mutant in enumerate(drawn, 1):
            if asked.only and number not in asked.only:
                continue
            if asked.list:
                print(number, mutant)
                continue
            began = time.monotonic()
            by = trial.notice(mutant, asked.last)
            tried += 1
            noticed += bool(by)
            print(f"{number}\t{mutant}\t{by or 'NOT NOTICED'}\t{time.monotonic() - began:.0f} s", flush=True)
    print(f"{noticed} of {tried} noticed (seed {asked.seed})")


if __name__ == "__main__":
    main()
