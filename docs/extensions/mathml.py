"""Sphinx extension: formulas as MathML, which browsers set without scripts or a network."""

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

_log = logging.getLogger(__name__)


def _written(translator: HTML5Translator, node: nodes.Element, display: str) -> None:
    try:
        formula = convert(node.astext(), display=display)
    except Exception as error:  # whatever the converter stumbles on is the page's mistake
        _log.warning("formula %r: %s", node.astext(), error, location=node)
        formula = ""
    translator.body.append(formula)


def _visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    _written(translator, node, "inline")
    raise nodes.SkipNode


def _visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(translator.starttag(node, "div", CLASS="formula"))
    _written(translator, node, "block")
    translator.body.append("</div>")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Offer the renderer that `html_math_renderer = "mathml"` names."""
    app.add_html_math_renderer("mathml", (_visit_inline, None), (_visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
