"""The pages of the Python interface, from the public names and their docstrings."""

import importlib
import inspect


def page(package: str) -> str:
    """One package's public names, in MyST Markdown with directives of autodoc."""
    module = importlib.import_module(package)
    parts = [
        f"# {package}",
        "",
        inspect.cleandoc(module.__doc__ or "").partition(":")[0] + ".",
        "",
    ]
    for name in module.__all__:
        found = getattr(module, name)
        if inspect.isclass(found):
            directive = "autoexception" if issubclass(found, BaseException) else "autoclass"
            options = [":members:"]
        else:
            directive, options = "autofunction", []
        parts += [f"## {name}", "", "```{eval-rst}", f".. {directive}:: {package}.{name}"]
        parts += [f"   {option}" for option in options]
        parts += ["```", ""]
    return "\n".join(parts)
