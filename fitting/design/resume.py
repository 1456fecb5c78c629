"""Searches that have ended, kept in a file, so that a design which was interrupted goes on."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, PlainSerializer, PlainValidator, ValidationError

from fitting.arrays import Floats
from fitting.datasheet.variants import variants_of
from fitting.design.problem import Outcome
from fitting.design.search import Trial
from fitting.design.want import Want
from suas_jax.files.command import allow_replacing, own_output
from suas_jax.files.reading import MEGABYTE, read_bytes
from suas_jax.files.writing import write_text
from suas_jax.runtime.content_key import content_key, source_digest

# Of a want, what decides neither what a search finds nor where it begins.
_ASIDE = ("skin", "spec", "starts", "seed", "keep", "front")


_Array = Annotated[
    Any, PlainValidator(lambda rows: np.array(rows, float)), PlainSerializer(np.ndarray.tolist)
]


class _Outcome(BaseModel):
    values: dict[str, _Array]
    slopes: dict[str, _Array]
    found: bool


class _Trial(BaseModel):
    model_config = ConfigDict(ser_json_inf_nan="constants")

    start: _Array
    x: _Array
    goal: float
    message: str
    multipliers: _Array
    first: _Outcome
    last: _Outcome
    calls: int

    @classmethod
    def of(cls, trial: Trial) -> Self:
        ends = {key: getattr(trial, key)._asdict() for key in ("first", "last")}
        return cls(**trial._asdict() | ends)

    def read(self) -> Trial:
        ends = {key: Outcome(**dict(getattr(self, key))) for key in ("first", "last")}
        return Trial(**dict(self) | ends)


class _File(BaseModel):
    model_config = ConfigDict(ser_json_inf_nan="constants")

    searches: dict[str, _Trial] = {}


class KeptSearches:
    """Searches by what they wanted, and of which skin, and where they began.

    `path`: of the file; one that is there is read. Raises ValueError: it is something else.
    """

    def __init__(self, path: Path) -> None:
        own_output(path)
        allow_replacing(path)  # by what it holds and more
        self._path, self._file = path, _File()
        self._before, self._fitting = 0, 0  # searches that were there; those of the design
        if path.exists():
            try:
                text = read_bytes(path, 100 * MEGABYTE, remember=False)
                self._file = _File.model_validate_json(text)
            except ValidationError:
                raise ValueError(
                    f"{path}: does not hold searches of suas design; name another file"
                ) from None
            self._before = len(self._file.searches)

    @property
    def note(self) -> str:
        """What is to be said of a file none of whose searches was of the design."""
        if not self._before or self._fitting:
            return ""
        return (
            f"{self._path}: holds {self._before} searches of another design, skin or version "
            "of suas; all of this one's were made anew"
        )

    def known(self, want: Want, start: Floats) -> Trial | None:
        """The search from a start, if it has ended before."""
        kept = self._file.searches.get(_key(want, start))
        self._fitting += kept is not None
        return None if kept is None else kept.read()

    def add(self, want: Want, trial: Trial) -> None:
        """Keep a search that has ended."""
        self._file.searches[_key(want, trial.start)] = _Trial.of(trial)
        write_text(self._path, self._file.model_dump_json())


def _key(want: Want, start: Floats) -> str:
    fields = [f.name for f in dataclasses.fields(want) if f.name not in _ASIDE]
    told = [getattr(want, name) for name in fields], want.against, start.tolist()
    errors = variants_of(want.spec).errors  # of which neither a number nor its text tells
    tolerances = errors.paths, errors.directions
    return content_key((source_digest(), repr(want.spec), told, tolerances))
