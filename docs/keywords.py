"""The keywords of functions that end in ``**options: Unpack[...]``, for the API page and the list of the public API.

An extension of griffe, which reads sources alone: the options' defaults and help are in dataclasses (options/), from
which unshutter.options.description makes the functions' signatures and docstrings.
"""

import inspect
from importlib import import_module
from typing import Any

import griffe


class Keywords(griffe.Extension):
    """Gives such functions their signatures and docstrings."""

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """One function."""
        last = list(func.parameters)[-1:]
        if not last or last[0].kind is not griffe.ParameterKind.var_keyword or "Unpack[" not in str(last[0].annotation):
            return
        if "overload" in func.labels or func.docstring is None:
            return
        function = getattr(import_module(func.parent.path), func.name)
        del func.parameters[last[0].name]
        for parameter in inspect.signature(function).parameters.values():
            if parameter.name not in func.parameters:
                annotation, default = str(parameter.annotation), repr(parameter.default)
                keyword = griffe.Parameter(
                    parameter.name, annotation=annotation, kind=griffe.ParameterKind.keyword_only, default=default
                )
                func.parameters.add(keyword)
        func.docstring.value = inspect.cleandoc(function.__doc__)
