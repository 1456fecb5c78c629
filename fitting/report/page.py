"""Pages from templates: values are escaped, and no host is asked for anything."""

from typing import Any

import jinja2


def page(package: str, template: str, **values: Any) -> str:
    """Fill in a template that extends `page.html.j2`.

    Args:
        package: where the template lies, such as "fitting.calibration".
        template: its file.
        values: by the names that it has for them; all of these must be given.

    Raises:
        jinja2.UndefinedError: a value is missing.
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
