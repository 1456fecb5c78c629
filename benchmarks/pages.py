"""Where benchmarks write their tables: between markers of pages in docs/."""

import re
from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs"


def write_section(page: str, name: str, lines: list[str]) -> None:
    """Replace what stands between ``<!-- name: begin -->`` and ``<!-- name: end -->``."""
    path = DOCS / page
    text = path.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    new = "\n".join([begin, "", *lines, "", end])
    text = re.sub(f"{re.escape(begin)}.*{re.escape(end)}", lambda _: new, text, flags=re.DOTALL)
    path.write_text(text, encoding="utf-8")
