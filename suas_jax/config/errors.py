"""What is wrong with a configuration file, said so that it can be put right."""

import datetime
import difflib
import itertools
import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

_LONGEST_WORD = 100  # characters; longer ones are not a slip of the finger


class Mistake(NamedTuple):
    """One mistake in a configuration."""

    file: str  # that holds it, as the user named it
    key: str  # dotted path inside the file, such as ``load.1.force``; empty for the whole file
    advice: str  # what is allowed, and what to do
    # the offending value as it would stand in the file; None if there is none
    value: str | None = None

    def __str__(self) -> str:
        key = f"{self.key} = {self.value}" if self.key and self.value is not None else self.key
        return ": ".join(part for part in (self.file, key, self.advice) if part)


class ConfigError(ValueError):
    """A configuration can't be used; the message lists every mistake, one on each line.

    Attributes:
        mistakes: in the order of the file's tables.
    """

    def __init__(self, mistakes: Iterable[Mistake]):
        self.mistakes = tuple(dict.fromkeys(mistakes))
        super().__init__("\n".join(str(mistake) for mistake in self.mistakes))

    def __reduce__(self) -> "tuple[type[ConfigError], tuple[tuple[Mistake, ...]]]":
        return type(self), (self.mistakes,)


def show(value: object, limit: int = 60) -> str:
    """Write a value the way it stands in a TOML file, shortened for a message."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        text = (
            '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'
        )
    elif isinstance(value, Mapping):
        # More entries than characters that are shown need not be looked at.
        entries = itertools.islice(value.items(), limit)
        inside = ", ".join(f"{key} = {show(item)}" for key, item in entries)
        text = f"{{ {inside} }}" if inside else "{}"
    elif isinstance(value, list | tuple):
        text = "[" + ", ".join(show(item) for item in value[:limit]) + "]"
    elif isinstance(value, datetime.date | datetime.time):
        text = value.isoformat()
    else:
        text = str(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def show_key(key: object) -> str:
    """Write a key or an index the way it stands in a dotted path."""
    text = str(key)
    return text if re.fullmatch(r"[A-Za-z0-9_-]+", text) else show(text)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Find the known word that ``word`` was probably meant to be, whatever its case."""
    if len(word) > _LONGEST_WORD:
        return None
    folded = {name.casefold(): name for name in known}
    close = difflib.get_close_matches(word.casefold(), folded, n=1, cutoff=0.6)
    return folded[close[0]] if close else None


def listed(words: Iterable[str]) -> str:
    """Join words for a sentence: ``a``, ``a or b``, ``a, b or c``."""
    every = list(words)
    return " or ".join(part for part in (", ".join(every[:-1]), *every[-1:]) if part)


def unknown(word: str, known: Iterable[str], what: str, *, quoted: bool = False) -> str:
    """Say that a word of some kind is unknown, and which known one it may be meant to be.

    Values of a file are shown in quotes.
    """
    names = list(known)
    near = nearest(word, names)
    hint = f'did you mean "{near}"? ' if near else ""
    return f"unknown {what}; {hint}allowed: {listed(map(show, names) if quoted else names)}"
