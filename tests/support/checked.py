"""Shapes that annotations state are checked at every call while the tests run (jaxtyping, beartype).

Of the modules below, public functions and methods are checked as soon as a module is imported, arguments and results
alike; arrays only: what else is wrong with an argument, functions say in their own words. What a call with arrays of
the same shapes and types has passed already is passed again without a look: a look takes 50 us, 20 times as long.
"""

import ast
import functools
import inspect
import sys
import typing
from collections.abc import Callable, Iterator
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray, jaxtyped

CHECKED = {
    "unshutter_lab.evaluation.metrics",
    "unshutter_lab.methods.curves",
    "unshutter.single.likelihood",
    "unshutter.motion.rotations",
    "unshutter.motion.geometry",
    "unshutter.motion.motion",
    "unshutter_lab.methods.row_map",
    "unshutter.motion.verdict",
    "unshutter_lab.synthesis.row_motions",
    "unshutter.motion.edges",
    "unshutter.motion.grid",
    "unshutter.motion.warp",
}
FOUND: dict[str, list[str]] = {}  # module, once it is imported -> its functions that are checked


def check_shapes() -> None:
    """From now on; to be called before the first of these modules is imported."""
    assert not CHECKED & sys.modules.keys()
    sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds the modules where they are, and has them checked once they have run."""

    def find_spec(self, fullname: str, path: object, target: ModuleType | None = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path, target) if fullname in CHECKED else None
        if spec is not None:
            run = spec.loader.exec_module

            def run_and_check(module: ModuleType) -> None:
                run(module)
                _check(module)

            spec.loader.exec_module = run_and_check
        return spec


def _check(module: ModuleType) -> None:
    _import_for_annotations(module)
    found = FOUND.setdefault(module.__name__, [])
    for owner in (module, *(value for _, value in _public_of(module, module) if inspect.isclass(value))):
        for name, value in _public_of(owner, module):
            if not inspect.isclass(value) and _states_shapes(value):
                checked = _checked(_function(value))
                setattr(owner, name, checked if inspect.isfunction(value) else type(value)(checked))
                found.append(name)


def _import_for_annotations(module: ModuleType) -> None:
    """What the module imports for type checkers only, imported."""
    for node in ast.parse(inspect.getsource(module)).body:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            exec(compile(ast.Module(node.body, []), module.__file__, "exec"), vars(module))


def _public_of(owner: ModuleType | type, module: ModuleType) -> Iterator[tuple[str, typing.Any]]:
    """Classes and functions that the module itself defines."""
    for name, value in list(vars(owner).items()):
        function = _function(value)
        defined_here = getattr(function, "__module__", "") == module.__name__
        public = name == "__init__" or not name.startswith("_")
        if defined_here and public and (inspect.isclass(value) or inspect.isfunction(function)):
            yield name, value


def _function(value: typing.Any) -> typing.Any:
    """What is called for a class method, static method or property; anything else as it is."""
    return getattr(value, "__func__", getattr(value, "fget", value))


def _states_shapes(value: typing.Any) -> bool:
    """Whether an annotation does; a name in it that is unknown, which jaxtyped would pass over, is an error."""
    function = _function(value)
    quoting = [hint for hint in function.__annotations__.values() if "'" in str(hint)]
    return any(_is_array(eval(hint, function.__globals__)) for hint in quoting)


def _checked(function: Callable) -> Callable:
    check = jaxtyped(function, typechecker=_arrays_only)
    if any("{" in str(hint) for hint in function.__annotations__.values()):  # more than shapes decides
        return check
    passed = set()

    @functools.wraps(function)
    def call(*args: typing.Any, **kwargs: typing.Any) -> typing.Any:
        given = (_shapes(args), tuple(kwargs), _shapes(tuple(kwargs.values())))
        if given in passed:
            result = function(*args, **kwargs)
            if (given, _shapes(result)) in passed:
                return result
        result = check(*args, **kwargs)  # perhaps once more: these functions change nothing
        passed.update((given, (given, _shapes(result))))
        return result

    return call


def _shapes(value: typing.Any) -> object:
    """All that annotations of arrays can tell apart, to be compared."""
    if isinstance(value, tuple):
        return tuple(map(_shapes, value))
    return (type(value), value.dtype, tuple(value.shape)) if hasattr(value, "shape") else type(value)


def _arrays_only(function: Callable) -> Callable:
    hints = function.__annotations__
    function.__annotations__ = {name: hint for name, hint in hints.items() if _is_array(hint)}
    return beartype(conf=BeartypeConf(is_pep484_tower=True))(function)


def _is_array(hint: object) -> bool:
    inside = typing.get_args(hint)
    return any(map(_is_array, inside)) or (inspect.isclass(hint) and issubclass(hint, AbstractArray))
