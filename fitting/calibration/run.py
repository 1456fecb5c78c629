"""`suas calibrate`: record what is still missing, fit, verify, write the skin and the page."""

import contextlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from fitting.calibration.html_report import Verification, html_report, verify
from fitting.calibration.plan import Step, edge_of
from fitting.calibration.recording import InterruptedStepError, Rest, StepRecorder
from fitting.inverse_load.live.run import picture
from fitting.inverse_load.readings import Layout
from fitting.sensor.fit.calibrate import fit_sensor
from fitting.sensor.logs.data import load_sensor_data
from fitting.sensor.model.constants import PATHS
from fitting.sensor.report.skin_file import calibrated_skin
from fitting.sensor.report.summary import sensor_report
from suas_jax.acquisition.baseline import Baseline, take_baseline
from suas_jax.acquisition.frames.registry import decoder, open_source
from suas_jax.acquisition.health import Health, log_health
from suas_jax.acquisition.log.log_file import LogWriter, log_header, read_log
from suas_jax.acquisition.log.record import FLAG_COLUMNS, write_reading
from suas_jax.acquisition.stream import Judged, Stream, ended_by_signal
from suas_jax.config import SkinSpec, continuous_inputs, load_skin
from suas_jax.config.toml_file import MOST_BYTES
from suas_jax.files.ownership import owned
from suas_jax.files.reading import MEGABYTE, read_bytes, sha256_of
from suas_jax.files.writing import write_text, written
from suas_jax.sensing.taxels import taxel_places

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


@dataclass(frozen=True)
class CalibrationOptions:
    """How to calibrate."""

    port: str  # as `suas log` takes it
    skin: Path  # the skin file
    output: Path  # the calibrated one
    page: Path  # the report (HTML)
    folder: Path  # where the logs of the steps lie
    steps: tuple[Step, ...]  # what is recorded
    format_name: str
    baud: int  # bits per second
    hold: float  # how long each load is to be held still [s]
    timeout: float  # how long a step may take [s]
    fit: Sequence[str]  # names of the constants
    model: str  # shapes of the membrane, as for `fit_sensor`
    place_error: float  # standard deviation of the presses' places, likewise [m]


def run_calibration(options: CalibrationOptions, say: Callable[[str], None]) -> dict[str, Any]:
    """Calibrate a skin with a person's help.

    Returns the report of `suas fit sensor`, with `verification` and the files' names.
    Raises InterruptedStepError: a step was not done; the next call resumes there.
    Raises OwnedError: another process records to the folder.
    Raises ValueError: the device is of another layout, or the readings can't be used.
    Raises PortError: the port can't be opened.
    """
    spec = load_skin(options.skin)
    if spec.electrodes is None:
        raise ValueError(f"{options.skin}: no [electrodes]: the skin senses nothing")
    with CalibrationFolder.owned(options.folder, options.skin, options.steps) as folder:
        if folder.open_steps:
            _record(spec, folder, options, say)
        return _fitted(spec, folder, options)


def _fitted(
    spec: SkinSpec, folder: CalibrationFolder, options: CalibrationOptions
) -> dict[str, Any]:
    """Fit and verify what is recorded, and write the skin and the page."""
    baseline, health = _at_rest(folder, options)
    fitted = [step for step in options.steps if not step.verifies]
    data = load_sensor_data(spec, [folder.log(step) for step in fitted])
    fit = fit_sensor(data, options.fit, model=options.model, place_error=options.place_error)
    write_text(options.output, calibrated_skin(options.skin, fit))
    report = sensor_report(fit) | {
        "skin": str(options.skin),
        "skin_file": str(options.output),
        "page": str(options.page),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "before": _before(spec, fit.family.names),
    }
    checks = verify(
        load_skin(options.output),
        baseline,
        [(s.press, folder.log(s)) for s in options.steps if s.verifies and s.press is not None],
    )
    report["verification"] = [_check_json(check) for check in checks]
    report["verified"] = all(check.passed for check in checks) if checks else None
    places = [*taxel_places(spec.sensing, spec.geometry).values()]
    page = html_report(spec, places, report, options.steps, checks, health)
    write_text(options.page, page)
    return report


def _record(
    spec: SkinSpec,
    folder: CalibrationFolder,
    options: CalibrationOptions,
    say: Callable[[str], None],
) -> None:
    decode = decoder(options.format_name)
    source = open_source(options.port, options.format_name, options.baud)
    taxels = spec.sensing.taxels_by_module
    stream = Stream(source, decode, options.format_name, report=say, taxels=taxels)
    header = log_header(
        skin=str(options.skin),
        scale=f"{1e15 * spec.sensing.lsb:.9g} fF",
        port=options.port,
        frame_format=options.format_name,
    )
    recorder = StepRecorder(
        stream, Layout(spec), hold=options.hold, timeout=options.timeout, say=say
    )
    done = len(options.steps) - len(folder.open_steps)
    if done:
        say(f"{done} of {len(options.steps)} steps are there already: going on")
    with ended_by_signal(stream), contextlib.closing(recorder):
        try:
            rest = _rest(folder, recorder, options, header, decode.extra_columns, say)
            for number, step in enumerate(options.steps, start=1):
                if step in folder.open_steps and step.press is not None:
                    say(f"{number} of {len(options.steps)}: press {step.press.text}, and hold")
                    say(_drawn(spec, step))
                    rows = recorder.press(rest)
                    folder.keep(step, rows, header, decode.extra_columns)
        except InterruptedStepError as error:
            raise InterruptedStepError(
                f"{error}; what is done is kept in {folder.folder}: the same command goes on"
            ) from None


def _rest(
    folder: CalibrationFolder,
    recorder: StepRecorder,
    options: CalibrationOptions,
    header: dict[str, str],
    extra_columns: tuple[str, ...],
    say: Callable[[str], None],
) -> Rest:
    """Readings at rest; where they were recorded before, what they are this time."""
    step = options.steps[0]
    again = step not in folder.open_steps
    first = f"1 of {len(options.steps)}: leave the skin alone"
    say("take everything off the skin" if again else first)
    rows, rest = recorder.rest()
    if not again:
        folder.keep(step, rows, header, extra_columns)
    return rest


def _drawn(spec: SkinSpec, step: Step) -> str:
    """Where to press, as lines of characters: along the arc, on a pad also along the axis."""
    assert step.press is not None
    edge = edge_of(spec)[0]
    millimetres: dict[str, Any] = {"unit": "mm", "scale": 1e3}
    along = millimetres if step.press.by == "arc" else {}
    lines = picture([step.press.place], edge, **along)
    if step.press.axial is None:
        return lines
    half = spec.geometry.width / 2
    return f"{lines}\n{picture([step.press.axial], half, **millimetres)}"


def _at_rest(folder: CalibrationFolder, options: CalibrationOptions) -> tuple[Baseline, Health]:
    """What the log at rest says; asked first, as fitting and verifying take minutes."""
    path = folder.log(options.steps[0])
    log = read_log(path)
    try:
        return take_baseline(log), log_health(log)
    except ValueError as error:
        raise ValueError(f"{error}; remove {path} and repeat the command") from None


def _before(spec: SkinSpec, names: Sequence[str]) -> dict[str, float]:
    """The skin file's values of the constants, by name."""
    inputs = continuous_inputs(spec)
    paths = {name: PATHS.get(name, name) for name in names}
    return {name: float(inputs[path]) for name, path in paths.items() if path in inputs}


def _check_json(check: Verification) -> dict[str, Any]:
    by_arc = check.press.by == "arc"
    name, scale = ("arc_m", 1.0) if by_arc else ("angle_deg", math.degrees(1))
    return {
        name: scale * check.press.place,
        "force_N": check.press.force,
        "axial_m": check.press.axial,
        "status": check.status,
        f"estimated_{name}": scale * check.place,
        "estimated_force_N": check.force,
        "estimated_axial_m": check.axial,
        "passed": check.passed,
    }
