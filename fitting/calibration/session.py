"""Folder of a guided calibration: the steps recorded so far, whole after an interruption."""

import contextlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

from fitting.calibration.plan import Step
from suas_jax.acquisition.log.log_file import LogWriter
from suas_jax.acquisition.log.record import FLAG_COLUMNS, write_reading
from suas_jax.acquisition.stream import Judged
from suas_jax.config.toml_file import MOST_BYTES
from suas_jax.files.ownership import owned
from suas_jax.files.reading import MEGABYTE, read_bytes, sha256_of
from suas_jax.files.writing import write_text, written

_PLAN = "plan.json"


class CalibrationFolder:
    """The logs of a calibration, each written whole when its step is done.

    The folder is made by `owned`; the skin is the file that is calibrated.
    Raises ValueError: the folder holds a calibration of another skin, or with other loads.
    """

    def __init__(self, folder: Path, skin: Path, steps: Sequence[Step]) -> None:
        self.folder = folder
        self._steps = tuple(steps)
        plan = {
            "skin_sha256": sha256_of(skin, MOST_BYTES),
            "steps": [asdict(step) for step in steps],
        }
        file = folder / _PLAN
        if file.exists():
            self._check(file, plan)
        else:
            write_text(file, json.dumps(plan, indent=1) + "\n")

    @classmethod
    @contextlib.contextmanager
    def owned(cls, folder: Path, skin: Path, steps: Sequence[Step]) -> Iterator[Self]:
        """The folder, which no other process records to meanwhile; as the class.

        Raises OwnedError: another process records to it.
        """
        folder.mkdir(parents=True, exist_ok=True)
        with owned(folder / _PLAN):
            yield cls(folder, skin, steps)

    def _check(self, file: Path, plan: dict[str, Any]) -> None:
        try:
            before = json.loads(read_bytes(file, MEGABYTE, remember=False))
        except (ValueError, RecursionError):
            before = None
        if before != json.loads(json.dumps(plan)):
            raise ValueError(
                f"{self.folder}: holds a calibration of another skin file or with other loads; "
                "ask for the same, name another --folder, or remove it to begin again"
            )

    def log(self, step: Step) -> Path:
        """Where a step's log lies."""
        return self.folder / f"{step.name}.csv"

    @property
    def open_steps(self) -> tuple[Step, ...]:
        """The steps that are still to be recorded."""
        return tuple(step for step in self._steps if not self.log(step).exists())

    def keep(
        self,
        step: Step,  # that was recorded
        readings: Sequence[Judged],  # its rows
        header: Mapping[str, str],
        extra_columns: tuple[str, ...],  # that the frame format adds
    ) -> None:
        """Write a step's log, with its known load in the header."""
        known = dict(header) | _known(step)
        path = self.log(step)
        began = readings[0].reading.t_host
        with written(path) as draft:
            columns = FLAG_COLUMNS + extra_columns
            with LogWriter(draft, known, flags=columns, flush_interval=1.0) as log:
                log.start(max(len(judged.reading.counts) for judged in readings))
                for judged in readings:
                    write_reading(log, judged, began)


def _known(step: Step) -> dict[str, str]:
    """The known load as header lines that `suas fit sensor` takes."""
    press = step.press
    if press is None:
        return {"load_0_force_N": "0", "load_0_arc_mm": "0"}
    place = ("load_0_angle_deg", math.degrees(press.place))
    if press.by == "arc":
        place = ("load_0_arc_mm", 1e3 * press.place)
    known = {"load_0_force_N": f"{press.force:.9g}", place[0]: f"{place[1]:.9g}"}
    if press.axial is not None:
        known["load_0_axial_mm"] = f"{1e3 * press.axial:.9g}"
    return known
