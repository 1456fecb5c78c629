"""Sphinx extension: places where a long name in code may break.

Browsers break `--plot` after its hyphens and `min_gap_angle_deg` anywhere or nowhere. So words
of code stay whole, as Sphinx has them, and long ones are written in pieces that end where a
reader would break them. `site.css` says when: on a phone, in tables; in its text, and in the
tables of a wide window, only what is nearly as long as the phone's line, marked `long`.
"""

import re
from typing import Any

from sphinx.application import Sphinx

_IN_TABLES = 12  # characters, of about 17 in a column
_ANYWHERE = 28  # of about 34 in an item of a list

_WORD = re.compile(rf'<span class="pre">([^<]{{{_IN_TABLES},}})</span>')


def _pieces(word: re.Match[str]) -> str:
    name = word[1]
    ends = next((end for end in "/." if end in name), "_=:,-")  # paths at their folders only
    # Hyphens before an option, and a last piece like `py` or `deg`, don't stand alone.
    end_of_piece = rf"(?<=[\w)/][{ends}])(?=\w)(?!\w{{1,4}}$)"
    sort = ' class="long"' if len(name) >= _ANYWHERE else ""
    pieces = re.sub(end_of_piece, f'</span><wbr{sort}><span class="pre">', name)
    return f'<span class="pre">{pieces}</span>'


def _break_names(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: object
) -> None:
    if "body" in context:
        context["body"] = _WORD.sub(_pieces, context["body"])


def setup(app: Sphinx) -> dict[str, Any]:
    """Let every page's names break."""
    app.connect("html-page-context", _break_names)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
