"""Equations of the docs: what stands in a ```math block (TeX, as forges show it, too) becomes MathML, without scripts.

A hook of MkDocs (mkdocs.yml); needs latex2mathml, from the extra ``docs``.
"""

import re

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

_BLOCK = re.compile(r"^```math\n(.+?)\n```$", re.MULTILINE | re.DOTALL)


def on_page_markdown(markdown: str, **_: object) -> str:
    """The page with its equations replaced, each a paragraph of its own."""
    return _BLOCK.sub(_equation, markdown)


def _equation(found: re.Match[str]) -> str:
    mathml = convert(found[1], display="block")
    if "<mi>&</mi>" in mathml or "<mi>\\" in mathml:  # what the converter does not know it writes out
        raise PluginError(f"TeX that latex2mathml does not know: {found[1]}")
    return f'<div class="equation">{mathml}</div>'
