"""The page of the commands, from the parser of the program."""

import inspect
from typing import Any

import typer.main

from fitting.cli.app import app
from fitting.cli.commands import EXAMPLES

HEAD = """# Commands

`suas` without a command lists them, `suas COMMAND --help` describes one, and
`suas --install-completion` makes the shell complete commands and options. Exit status: 0 done,
2 bad input or a machine that can't do it, 3 no solution found, 130 interrupted. With `--json` a
failure is also an object with `status` and `message` on standard output. No command replaces a
file unless `--overwrite` is given.

The files in the examples are written by `suas examples`; a checkout has them. This page is
written from the program's own parser.
"""


def page() -> str:
    """The whole page, in MyST Markdown."""
    return "\n".join([HEAD, *_sections(typer.main.get_command(app), "")])


def _sections(group: Any, words: str) -> list[str]:
    sections = []
    for name, command in group.commands.items():
        path = f"{words} {name}".strip()
        if hasattr(command, "commands"):
            sections += _sections(command, path)
        else:
            sections.append(_section(path, command))
    return sections


def _section(words: str, command: Any) -> str:
    text = inspect.cleandoc(command.help or "").replace("<", "\\<")
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.param_type_name == "option"]
    usage = [f"suas {words}", *(_shown(p) for p in arguments), "[OPTIONS]"]
    lines = [f"## suas {words}", "", text, "", "```text", " ".join(usage), "```", ""]
    if words in EXAMPLES:
        lines += ["```console", *(f"$ {line}" for line in EXAMPLES[words]), "```", ""]
    lines += ["| argument or option | meaning | default |", "|---|---|---|"]
    lines += [_row(p) for p in [*arguments, *options] if p.name != "help"]
    return "\n".join([*lines, ""])


def _shown(argument: Any) -> str:
    name = argument.metavar or argument.name.upper()
    return name if argument.required else f"[{name}]"


def _row(parameter: Any) -> str:
    names = parameter.metavar or parameter.name.upper()
    if parameter.param_type_name == "option":
        names = ", ".join([*parameter.opts, *parameter.secondary_opts])
        if not parameter.is_flag:
            kind = getattr(parameter.type_descriptor.annotation, "__name__", "text")
            value = parameter.metavar or {"str": "TEXT", "Path": "FILE"}.get(kind, kind.upper())
            names += f" {value}"
    default = parameter.default
    shown = "" if default in (None, False, ()) or default == [] else f"`{default}`"
    if parameter.required:
        shown = "required"
    elif parameter.param_type_name == "argument" and default is None:
        shown = "optional"
    cells = (f"`{names}`", (parameter.help or "").replace("<", "\\<"), shown)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
