"""Settings of an estimator of loads, and what they may be."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fitting.arrays import Floats
from suas_jax.config import SkinSpec

if TYPE_CHECKING:
    from fitting.inverse_load.pad.table import PadResolution

MODEL_ERROR = 2.5e-3
"""Error of the shell's change of readings, relative (`benchmarks/inverse_load.py`)."""
MOST_CONTACTS = 3
MOST_ON_PADS = 4
PAD_MODEL_ERROR = 1e-2
"""The same of a pad's table, taxel by taxel; what all taxels share is `PadDiscrepancy`'s."""
DIAMETER = 6e-3
"""Of contacts on a pad where nothing else is said [m]: a fingertip's."""


@dataclass
class EstimatorSettings:
    """Settings of a `LoadEstimator`, which says what each of them means."""

    spec: SkinSpec
    direction: bool = False
    false_alarm: float = 0.01
    noise: float | None = None
    model_error: float | None = None
    rest: Floats | None = None
    rest_variance: Floats | float = 0.0
    most_contacts: int = MOST_CONTACTS
    live: bool = False
    progress: Callable[[str], None] = lambda text: None
    diameter: float | None = DIAMETER
    pressure_noise: float = float("inf")
    follow_drift: bool = False
    workers: Executor | None = None
    resolution: "PadResolution | None" = None
    budget: float | None = None
    load_fields: bool | None = None

    def check(self) -> None:
        """Raises ValueError: a setting makes no sense."""
        if not 0 < self.false_alarm < 0.5:
            raise ValueError(
                f"false_alarm = {self.false_alarm:g}: a rate above 0 and below 0.5 is needed"
            )
        if not self.pressure_noise > 0:
            raise ValueError(
                f"pressure_noise = {self.pressure_noise:g} Pa: more than zero is needed"
            )
        pad = self.spec.geometry.dimension == 3
        if self.load_fields and self.spec.material.relaxation is not None:
            raise ValueError(
                "load_fields: the membrane remembers ([material] relaxation), and no pressure "
                "over the skin is told beside what it remembers; leave the load fields out"
            )
        most = MOST_ON_PADS if pad else MOST_CONTACTS
        if not 1 <= self.most_contacts <= most:
            raise ValueError(f"most_contacts = {self.most_contacts}: 1 to {most} are possible")
        if pad:
            self._check_pad()
        elif self.diameter != DIAMETER:
            raise ValueError("diameter is for pads; this skin is in plane strain")
        elif self.workers is not None:
            raise ValueError(
                "workers solve the tables of pads; that of a skin in plane strain takes seconds"
            )
        if self.budget is not None and not (self.budget > 0 and self.live and pad):
            raise ValueError(
                f"budget = {self.budget:g} s: a time above zero is needed, and live frames of "
                "a pad; logs and sections take the time they need"
            )
        if self.model_error is None:
            self.model_error = PAD_MODEL_ERROR if pad else MODEL_ERROR
        if not (np.isfinite(self.model_error) and self.model_error >= 0):
            raise ValueError(f"model_error = {self.model_error:g}: zero or more is needed")

    def _check_pad(self) -> None:
        if self.diameter is not None and not 0 < self.diameter < self.spec.geometry.width / 4:
            raise ValueError(
                f"diameter = {self.diameter:g} m: a length above zero and below a quarter of "
                "the pad's width is needed"
            )
