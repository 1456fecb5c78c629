"""Tools that fit the skin's model to measurements: docs/api.md."""

from __future__ import annotations

TYPE_CHECKING = False  # `suas` begins here, and can't answer Ctrl-C while typing is imported
if TYPE_CHECKING:
    from typing import Any

# Public names and where they live, imported when first used, as in suas_jax.
_HOMES = {
    "LoadEstimator": "fitting.inverse_load.estimator",
    "LiveLoads": "fitting.inverse_load.live.live_loads",
    "LoadFilter": "fitting.inverse_load.live.filter",
    "LoadFrame": "fitting.inverse_load.live.live_loads",
    "MaterialFit": "fitting.material.fit.result",
    "NoCalibration": "fitting.sensor.logs.data",
    "NoFit": "fitting.material.fit.search",
    "SensorFit": "fitting.sensor.fit.result",
    "calibrated_skin": "fitting.sensor.report.skin_file",
    "choose_taxels": "fitting.design.choice",
    "compare_laws": "fitting.material.fit.comparison",
    "data_sheet": "fitting.datasheet.sheet",
    "design_skin": "fitting.design.design",
    "fit_material": "fitting.material.fit.fit",
    "fit_sensor": "fitting.sensor.fit.calibrate",
    "live_loads": "fitting.inverse_load.live.live_loads",
    "load_dataset": "fitting.material.experiments.datasets",
    "load_sensor_data": "fitting.sensor.logs.data",
    "load_want": "fitting.design.want",
    "material_report": "fitting.material.report.summary",
    "readings_of": "fitting.inverse_load.readings",
    "sample_material": "fitting.material.fit.material_posterior",
    "sample_sensor": "fitting.sensor.fit.sensor_posterior",
    "sensor_report": "fitting.sensor.report.summary",
    "skin_with_zero": "fitting.inverse_load.zero.zero_file",
    "write_card": "fitting.material.cards.card",
    "zero_from_log": "fitting.inverse_load.zero.from_log",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOMES]
