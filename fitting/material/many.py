"""Many calibrations at once: a file of membranes in, one line of results a membrane out.

This process alone writes results, and never calibrates a membrane that the file already holds.
What a worker that dies had is done again elsewhere (`fitting.workers`).
"""

import contextlib
import json
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, as_completed
from pathlib import Path
from typing import Any

from fitting.json_text import json_text
from fitting.workers import LostWorkerError
from suas_jax.config import ConfigError
from suas_jax.config.toml_file import read_toml
from suas_jax.files.line_file import LineFile
from suas_jax.files.reading import MEGABYTE, read_bytes

_MOST_BYTES = 256 * MEGABYTE

KEYS = (
    *("name", "data", "law", "terms", "residual", "noise", "scene", "sample", "steps"),
    *("prony", "mullins"),
)


class JobError(ValueError):
    """The file of membranes is wrong; the message names file and key."""


def load_jobs(file: Path) -> list[dict[str, Any]]:
    """Read [[membrane]] tables; paths become absolute.

    Raises JobError: a key is unknown or missing, or a name stands twice.
    """
    try:
        table = read_toml(file)
    except ConfigError as error:
        raise JobError(str(error)) from None
    jobs = table.get("membrane")
    if set(table) != {"membrane"} or not isinstance(jobs, list) or not jobs:
        raise JobError(f"{file}: [[membrane]] tables are expected, and nothing else")
    seen: set[str] = set()
    for i, job in enumerate(jobs):
        where = f"{file}: membrane.{i}"
        for key in job:
            if key not in KEYS:
                raise JobError(f"{where}.{key}: unknown key; allowed: {', '.join(KEYS)}")
        name, data = job.get("name"), job.get("data")
        if not isinstance(name, str) or name in seen:
            raise JobError(f"{where}.name = {name!r}: a name of its own is needed")
        seen.add(name)
        if not isinstance(data, dict) or not data:
            raise JobError(f'{where}.data: expected {{ uniaxial = "A.csv", ... }}')
        job["data"] = {mode: str(file.parent / path) for mode, path in data.items()}
        if "scene" in job:
            job["scene"] = str(file.parent / job["scene"])
    return jobs


def calibrate(job: Mapping[str, Any]) -> dict[str, Any]:
    """Calibrate one membrane; what goes wrong is its result, not an exception."""
    from suas_jax.runtime.settings import configure

    configure()
    from fitting.material.calibration import calibrate as calibrate_law
    from fitting.material.experiments.datasets import load_dataset
    from fitting.material.experiments.measurements import mode_named
    from fitting.material.fit.search import NoFit
    from fitting.statistics.posterior import PosteriorError, Settings

    try:
        sets = [
            load_dataset(mode_named(mode), path, None, job.get("noise"), job.get("scene"))
            for mode, path in job["data"].items()
        ]
        fit, _, report = calibrate_law(
            sets,
            job.get("law", "ogden"),
            job.get("terms"),
            residual=job.get("residual", "relative"),
            prony=job.get("prony", 0),
            mullins=job.get("mullins", False),
        )
        if job.get("sample", False) and fit is not None:
            from fitting.material.fit.material_posterior import sample_material

            report["posterior"] = sample_material(
                fit, Settings(steps=job.get("steps", 20_000))
            ).report
    except (ValueError, OSError) as error:
        report = {"status": "bad_input", "message": str(error)}
    except (NoFit, PosteriorError) as error:
        report = {"status": "no_fit", "message": str(error)}
    return {"name": job["name"], **report}


def finished(results: Path) -> set[str]:
    """Names of the membranes that a file of results holds; a cut-off line is none."""
    names = set()
    if results.exists():
        for line in read_bytes(results, _MOST_BYTES).decode(errors="replace").splitlines():
            try:
                names.add(json.loads(line)["name"])
            except (json.JSONDecodeError, KeyError, TypeError):
                continue
    return names


def calibrate_all(
    jobs: list[dict[str, Any]],
    results: Path,  # JSON lines, appended to
    workers: Executor,  # that calibrate (`fitting.workers`)
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> int:
    """Calibrate every membrane that has no result yet.

    `progress`: called with membranes done, all of them, and the last one's name.
    Returns how many results were added.
    Raises LostWorkerError: names the membranes that took their workers with them; they have no
    result, all others have theirs; OwnedError: another process writes the file of results;
    ValueError: the file was deleted, moved or replaced; the results are beside it.
    """
    with contextlib.closing(LineFile.open(results)) as file:
        known = finished(results)
        added = 0
        waiting = [job for job in jobs if job["name"] not in known]
        names = {workers.submit(calibrate, job): job["name"] for job in waiting}
        lost: list[str] = []
        for future in as_completed(names):
            name, error = names[future], future.exception()
            if isinstance(error, LostWorkerError):
                lost.append(f"membrane {name}: {error}")
                continue
            if error is None:
                line = future.result()
            else:
                line = {"name": name, "status": "failed", "message": str(error)}
            file.append(json_text(line) + "\n")
            file.sync()
            added += 1
            progress(len(known) + added, len(jobs), name)
    if lost:
        raise LostWorkerError("\n".join(lost))
    if file.beside:
        raise ValueError(f"{results}: was lost; the results are in {file.beside[-1]}")
    return added
