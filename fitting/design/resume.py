"""Searches that have ended, kept in a file, so that a design which was interrupted goes on."""

import dataclasses
import hashlib
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from fitting.arrays import Floats
from fitting.design.problem import Outcome
from fitting.design.search import Trial
from fitting.design.want import Want
from suas_jax.files.command import allow_replacing, own_output
from suas_jax.files.reading import MEGABYTE, read_bytes
from suas_jax.files.writing import write_text
from suas_jax.runtime.content_key import source_digest

# Of a want, what decides neither what a search finds nor where it begins.
_ASIDE = ("skin", "spec", "starts", "seed", "keep", "front")


class _Outcome(BaseModel):
    model_config = ConfigDict(ser_json_inf_nan="constants")

    values: dict[str, list[float]]
    slopes: dict[str, list[list[float]]]
    found: bool

    @classmethod
    def of(cls, outcome: Outcome) -> Self:
        values, slopes = (
            {key: x.tolist() for key, x in table.items()} for table in outcome[:2]
        )
        return cls(values=values, slopes=slopes, found=outcome.found)

    def read(self) -> Outcome:
        tables = [
            {k: np.array(x) for k, x in table.items()} for table in (self.values, self.slopes)
        ]
        return Outcome(tables[0], tables[1], self.found)


class _Trial(BaseModel):
    model_config = ConfigDict(ser_json_inf_nan="constants")

    start: list[float]
    x: list[float]
    goal: float
    message: str
    multipliers: list[float]
    first: _Outcome
    last: _Outcome
    calls: int

    @classmethod
    def of(cls, trial: Trial) -> Self:
        own = trial._asdict()
        arrays = {key: own[key].tolist() for key in ("start", "x", "multipliers")}
        ends = {key: _Outcome.of(own[key]) for key in ("first", "last")}
        return cls(**own | arrays | ends)

    def read(self) -> Trial:
        ends = self.first.read(), self.last.read()
        arrays = [np.array(x) for x in (self.start, self.x, self.multipliers)]
        start, x, multipliers = arrays
        return Trial(start, x, self.goal, self.message, multipliers, *ends, self.calls)


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
        if path.exists():
            try:
                text = read_bytes(path, 100 * MEGABYTE, remember=False)
                self._file = _File.model_validate_json(text)
            except ValidationError:
                raise ValueError(
                    f"{path}: does not hold searches of suas design; name another file"
                ) from None

    def known(self, want: Want, start: Floats) -> Trial | None:
        """The search from a start, if it has ended before."""
        kept = self._file.searches.get(_key(want, start))
        return None if kept is None else kept.read()

    def add(self, want: Want, trial: Trial) -> None:
        """Keep a search that has ended."""
        self._file.searches[_key(want, trial.start)] = _Trial.of(trial)
        write_text(self._path, self._file.model_dump_json())


def _key(want: Want, start: Floats) -> str:
    fields = [f.name for f in dataclasses.fields(want) if f.name not in _ASIDE]
    told = [getattr(want, name) for name in fields], want.against, start.tolist()
    text = f"{source_digest()} {want.spec.model_dump_json()} {told!r}"
    return hashlib.sha256(text.encode()).hexdigest()
