"""The site: `make docs` builds it into docs/_build/html, warnings as errors."""

import re
import shutil
import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(HERE / "extensions"), str(ROOT)]

import commands_page  # noqa: E402
import demo_table  # noqa: E402
import folder_picture  # noqa: E402
import gallery_page  # noqa: E402
import names_page  # noqa: E402
import report_page  # noqa: E402
import specification_page  # noqa: E402

project = "suas_jax"
author = "the authors of suas_jax"
copyright = f"2026, {author}"
version = release = installed_version("suas-jax")

extensions = [
    "breakable_names",
    "mathml",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_build", "extensions", "gallery"]
nitpicky = False
smartquotes = False  # they would make dashes of options
default_role = "code"  # docstrings quote code as Markdown does

# Pages are Markdown; notebooks carry the outputs of their last run, which `make test` repeats.
nb_execution_mode = "off"
nb_merge_streams = True
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

html_math_renderer = "mathml"
autodoc_typehints = "signature"
python_maximum_signature_line_length = 88
napoleon_attr_annotations = False
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
copybutton_prompt_text = "$ "

html_theme = "pydata_sphinx_theme"
html_title = "suas_jax"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["generated/extra"]  # the demo, a page of its own
html_show_sourcelink = False
html_copy_source = False
html_context = {"default_mode": "auto"}  # without it the theme complains in the console
html_theme_options = {
    "header_links_before_dropdown": 8,
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "navbar_persistent": ["search-button"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}

_GENERATED = HERE / "generated"
_EXTRA = _GENERATED / "extra"
_EXTRA.mkdir(parents=True, exist_ok=True)
_PAGES = {
    "configuration": specification_page.page,
    "reports": report_page.page,
    "commands": commands_page.page,
    "suas_jax": lambda: names_page.page("suas_jax"),
    "fitting": lambda: names_page.page("fitting"),
    "gallery": lambda: gallery_page.page(_GENERATED / "gallery"),
}


def _write_if_new(path: Path, text: str) -> None:
    """Leave files alone that are as they should be, so that a second build is quick."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def _generate(app: Sphinx) -> None:
    """Write the pages that come from the code, and bring the notebooks under this folder."""
    _write_if_new(_EXTRA / "demo.html", demo_table.page())
    for name, page in _PAGES.items():
        _write_if_new(_GENERATED / f"{name}.md", page())
    folder_picture.draw(_GENERATED / "folders.svg")
    notebooks = HERE / "notebooks"
    shutil.rmtree(notebooks, ignore_errors=True)
    shutil.copytree(ROOT / "notebooks", notebooks, ignore=shutil.ignore_patterns(".*", "*.py"))


def _draw_folders(app: Sphinx, page: str, source: list[str]) -> None:
    """Put the picture of the imports above the table of the folders."""
    if page == "architecture":
        words = (
            f"![Imports between folders](generated/folders.svg)\n\n{folder_picture.WORDS}\n\n"
        )
        source[0] = source[0].replace("<!-- folders: begin -->", words)


def _add_unlisted_pages(app: Sphinx, page: str, source: list[str]) -> None:
    """List pages under the guides that no table of contents names, so that none is lost."""
    if page != "guides":
        return
    texts = {path.stem: path.read_text(encoding="utf-8") for path in HERE.glob("*.md")}
    tables = re.findall(r"{toctree}(.*?)```", "\n".join(texts.values()), re.DOTALL)
    listed = re.sub(r"^:.*", "", "\n".join(tables), flags=re.MULTILINE).split()
    rest = sorted(texts.keys() - {"index", *listed})
    if rest:
        head = ["", "```{toctree}", ":maxdepth: 1", ":caption: More", ""]
        lines = [*head, *rest, "```", ""]
        source[0] += "\n".join(lines)


_TYPES = {
    r"~?jax.Array \| ~?numpy.ndarray \| ~?numpy.bool \| ~?numpy.number "
    r"\| bool \| int \| float \| complex": "ArrayLike",
    r"~numpy.ndarray\[tuple\[~typing.Any, ...], ~numpy.dtype\[~numpy.(\w+)]]": r"NDArray[\1]",
    r"~?jaxlib._jax.Array": "Array",
    r"<function .*?<lambda>>": "...",
    r"<factory>": "...",  # isn't Python: the whole signature would stay unread, in one piece
}


def _shorten_types(*event: Any) -> tuple[str | None, ...]:
    """Types of arrays by the names that the code gives them."""

    def shortened(text: str | None) -> str | None:
        for long, short in _TYPES.items():
            text = text and re.sub(long, short, text)
        return text

    return tuple(map(shortened, event[-2:]))


def _always_read(*event: Any) -> list[str]:
    """Pages that depend on more than their own file."""
    return ["architecture", "guides"]


def setup(app: Sphinx) -> None:
    """Connect what this file adds to the build."""
    app.connect("builder-inited", _generate)
    app.connect("autodoc-process-signature", _shorten_types)
    app.connect("env-get-outdated", _always_read)
    app.connect("source-read", _add_unlisted_pages)
    app.connect("source-read", _draw_folders)
