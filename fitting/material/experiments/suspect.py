"""An artefact that a file seems to have, with its evidence and what mends it."""

import dataclasses
from typing import Any

import numpy as np

from fitting.material.experiments.stress_tests import StressTest


@dataclasses.dataclass(frozen=True)
class Suspect:
    """An artefact that a file seems to have."""

    # "break", "preconditioning", "percent", "slack", "toe", "force offset", "slip", "drift" or
    # "machine stiffness"
    kind: str
    file: str  # which file
    evidence: str  # what shows it
    option: str  # what corrects it, for the command line
    size: float | None = None  # how large it is, in `unit`; None where it has no size
    unit: str = ""  # of the size

    @property
    def text(self) -> str:
        """One sentence for people."""
        return f"{self.file}: suspect {self.kind}: {self.evidence}; mend it with {self.option}"

    @property
    def report(self) -> dict[str, Any]:
        """The attributes and the sentence, for JSON."""
        return {**dataclasses.asdict(self), "message": self.text}


def travel_of(data: StressTest, strain: float) -> tuple[float, str]:
    """A strain as travel of the machine where the specimen's length is known, and its unit."""
    if np.isfinite(data.origin.length):
        return 1e3 * strain * data.origin.length, "mm"
    return strain, "of the length"
