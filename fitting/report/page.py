"""Pages from templates: values are escaped, and no host is asked for anything."""

import base64
import io
from typing import Any

import jinja2
import matplotlib as mpl
from matplotlib.figure import Figure

_DOTS_PER_INCH = 110


def page(package: str, template: str, **values: Any) -> str:
    """Fill in a template that extends `page.html.j2`.

    `package`: where the template lies, such as "fitting.calibration". `template`: its file.
    `values`: by the names that it has for them; all of these must be given.
    Raises jinja2.UndefinedError: a value is missing.
    """
    loaders = [jinja2.PackageLoader(name, "") for name in (package, "fitting.report")]
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)


def embedded(figure: Figure, kind: str) -> str:
    """A figure as the address of an image that holds it; `kind`: "png" or "svg"."""
    content = io.BytesIO()
    with mpl.rc_context({"svg.fonttype": "path"}):
        figure.savefig(content, format=kind, dpi=_DOTS_PER_INCH)
    mime = {"svg": "svg+xml"}.get(kind, kind)
    return f"data:image/{mime};base64," + base64.b64encode(content.getvalue()).decode()
