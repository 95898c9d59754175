"""Sphinx settings of the site; ``docs/build.py`` prepares the pages and calls Sphinx."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert

project = "wbc"
copyright = "the wbc authors, Apache-2.0"
extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
# Pygments has no lexer for these words; they are shown as they are.
suppress_warnings = ["misc.highlighting_failure"]
html_theme = "furo"
html_title = "wbc"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False
html_math_renderer = "mathml"
pygments_style = "friendly"
pygments_dark_style = "monokai"


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.math_block) -> None:
    equation = convert(node.astext(), display="block")
    writer.body.append(f'<div class="math" style="overflow-x: auto; overflow-y: hidden">{equation}</div>\n')
    raise nodes.SkipNode


#: Code in a cell of a table, and the places where a long name may break: after a separator, before a capital letter.
CELL = re.compile(r"<t[dh]\b.*?</t[dh]>", re.DOTALL)
CODE = re.compile(r'(<span class="pre">)([^<]+)(?=</span>)')
BREAKS = re.compile(r"(?<=[/_.,(=\[])(?=[\w.({\[])|(?<=[a-z])(?=[A-Z])")


def _breakable(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Let code in tables break between the words of a name, not within one."""
    if body := context.get("body"):
        context["body"] = CELL.sub(lambda c: CODE.sub(lambda m: m[1] + BREAKS.sub("<wbr>", m[2]), c[0]), body)


def setup(app: Any) -> None:
    """Typeset mathematics as MathML, which browsers draw by themselves: no script, no font, no network."""
    app.connect("html-page-context", _breakable)
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
