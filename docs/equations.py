"""Equations of the docs: what stands in a ```math block (TeX, as forges show it, too) becomes MathML, without scripts.

A hook of MkDocs (mkdocs.yml); needs latex2mathml, from the extra ``docs``.
"""

import re

from latex2mathml.converter import convert

_BLOCK = re.compile(r"^```math\n(.+?)\n```$", re.MULTILINE | re.DOTALL)


def on_page_markdown(markdown: str, **_: object) -> str:
    """The page with its equations replaced, each a paragraph of its own."""
    return _BLOCK.sub(lambda found: f'<div class="equation">{convert(found[1], display="block")}</div>', markdown)
