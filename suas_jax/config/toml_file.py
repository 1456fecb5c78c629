"""Read a TOML file, or say where and why it can't be read."""

import os
import re
import tomllib
from pathlib import Path
from typing import Any

from suas_jax.config.errors import ConfigError, Mistake, nearest
from suas_jax.files.reading import MEGABYTE, read_bytes

MOST_BYTES = 3 * MEGABYTE
"""Size of a TOML file that is still read."""

_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")
# A dotted key at the start of a line or of an entry: the parser's time grows with the square
# of its parts, and what is nested deeply can't be shown.
_MOST_PARTS = 12
_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DEEP_KEY = re.compile(
    rf"(?:^[ \t]*+(?:\[\[?[ \t]*+)?|[{{,][ \t]*+){_PART}(?:\.[ \t]*+{_PART}){{{_MOST_PARTS}}}",
    re.MULTILINE,
)
_MOST_KEYS = 2000  # of one table
_BARE_QUANTITY = re.compile(r"=\s*\[?\s*([+-]?\d[\d.,]*(?:[eE][+-]?\d+)?)\s*([A-Za-zµμ°%]\S*)")
_BARE_WORD = re.compile(r"=\s*([A-Za-z][\w/^-]*)\s*(?:#.*)?$")


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Tables of a TOML file (UTF-8, with or without a byte order mark, any line ends).

    Raises ConfigError: the file can't be read, is not UTF-8 text, not TOML, or empty.
    """
    file = os.fspath(path)
    try:
        return _tables(file)
    except ValueError as error:
        raise ConfigError([Mistake(file, "", str(error))]) from None


def _tables(file: str) -> dict[str, Any]:
    """The same; refuses with the reason alone."""
    trouble = missing_file(file)
    if trouble:
        raise ValueError(trouble)
    try:
        raw = read_bytes(file, MOST_BYTES)
    except OSError as error:
        raise ValueError(f"can't be read: {error.strerror or error}") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(_not_text(error.object, error.start)) from None
    deep = _DEEP_KEY.search(text)
    if deep:
        line = text.count("\n", 0, deep.start()) + 1
        raise ValueError(
            f"line {line}: a key of more than {_MOST_PARTS} parts; no key here has so many"
        )
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(_not_toml(text, str(error))) from None
    except ValueError:
        raise ValueError("a whole number has thousands of digits") from None
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None
    if _depth(tables) > _MOST_PARTS:
        raise ValueError("tables are nested too deeply")
    every = (tables, *(t for t in tables.values() if isinstance(t, dict)))
    if any(len(table) > _MOST_KEYS for table in every):
        raise ValueError(f"a table of more than {_MOST_KEYS} keys")
    if not tables:
        raise ValueError("the file is empty: it holds no table")
    return tables


def _depth(tables: Any) -> int:
    """How deeply tables and lists are nested, without recursion."""
    depth, level = 0, [tables]
    while level:
        depth += 1
        inner = [x.values() if isinstance(x, dict) else x for x in level]
        level = [x for values in inner for x in values if isinstance(x, dict | list)]
    return depth


def missing_file(file: str, named_in: str = "") -> str | None:
    """Say why a path is not a file, with the nearest one beside it; None if it is one.

    `named_in`: the file that names it, which it can't have been meant to be.
    """
    path = Path(file)
    try:
        if path.is_dir():
            return "is a directory; name a TOML file"
        if path.exists():
            return None
        found = path.parent.glob("*.toml")
        beside = [entry.name for entry in found if not entry.match(named_in or "/")]
    except (OSError, ValueError) as error:  # such as a name with a NUL in it, or too long
        return f"can't be read: {error}"
    near = nearest(path.name, beside)
    return "no such file" + (f'; did you mean "{near}"?' if near else "")


def _not_text(raw: bytes, start: int) -> str:
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "is UTF-16 text; save it as UTF-8"
    line = raw.count(b"\n", 0, start) + 1
    column = start - (raw.rfind(b"\n", 0, start) + 1) + 1
    return (
        f"is not UTF-8 text (byte 0x{raw[start]:02x} at line {line}, column {column}); save it "
        f"as UTF-8"
    )


def _not_toml(text: str, message: str) -> str:
    """Turn the parser's message round: the place first, then the reason, then what to do."""
    lines = re.split(r"\r?\n", text)
    place = _PLACE.search(message)
    if place is None or place.group(1) is None:
        number, column = len(lines), len(lines[-1]) + 1
    else:
        number, column = int(place.group(1)), int(place.group(2))
    reason = _PLACE.sub("", message)
    # The parser shows names as Python tuples.
    reason = re.sub(r"\(('[^']*'(?:, '[^']*')*),?\)", r"[\1]", reason).replace("'", "")
    source = lines[min(number, len(lines)) - 1].strip()
    quantity, word = _BARE_QUANTITY.search(source), _BARE_WORD.search(source)
    if any(quote in source for quote in "“”„‘’"):
        hint = "; use straight quotes"
    elif quantity:
        hint = f'; quantities stand in quotes: "{quantity.group(1)} {quantity.group(2)}"'
    elif word:
        hint = f'; text stands in quotes: "{word.group(1)}"'
    elif "overwrite" in reason or "twice" in reason:
        hint = "; the name is already taken"
    else:
        hint = ""
    shown = f" in `{source[:60]}`" if source else ""
    return f"line {number}, column {column}: not valid TOML: {reason}{shown}{hint}"
