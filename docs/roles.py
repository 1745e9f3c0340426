"""Docstrings for the API page: what Sphinx marks as a role (:func:`name`, :meth:`~Class.name`) becomes `name` alone.

An extension of griffe, which mkdocstrings reads docstrings with (mkdocs.yml).
"""

import re
from typing import Any

import griffe

_ROLE = re.compile(r":(?:attr|class|data|exc|func|meth|mod):`~?([^`]+)`")


class Roles(griffe.Extension):
    """Rewrites docstrings as they are read."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """One docstring."""
        if obj.docstring:
            obj.docstring.value = _ROLE.sub(r"`\1`", obj.docstring.value)
