"""What the presses of a unit show beyond its model as built: `fitting.statistics.discrepancy`.

Places and forces are those that were told, but for what places are off by together: their
errors, which a fit finds press by press, would take up part of it.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.sensor.fit.result import SensorFit
from fitting.sensor.model.constants import PLACE, PUSH
from fitting.sensor.model.counts import parts_of
from fitting.statistics.discrepancy import Presses, learned
from fitting.statistics.residuals import sensitivity


def with_discrepancy(fit: SensorFit) -> SensorFit:
    """A unit's calibration with what its presses show beyond the model; a pad's as it is."""
    if fit.data.spec.geometry.dimension == 3:
        return fit
    numbers = fit.problem.model.numbers(jnp.asarray(fit.constants))
    *_, electrodes = parts_of(fit.data.spec, numbers)
    taxels = np.asarray(electrodes.taxels.angle)[:, 0]
    found = learned(presses_of(fit), taxels)
    return dataclasses.replace(fit, discrepancy=found)


def presses_of(fit: SensorFit) -> Presses:
    """Told presses and what the fit leaves of their readings."""
    here, names = fit.problem.readings, fit.family.names
    _, slopes = sensitivity(fit.residuals, jnp.asarray(fit.constants))
    taxels, frames = here.so.shape
    by = np.asarray(slopes)[: here.so.size].reshape(taxels, frames, -1) * here.sigma[..., None]
    left = -fit.problem.standardised(fit.constants) * here.sigma
    left = np.where(here.used, left, np.nan)
    so = fit.problem.predicted(fit.constants)
    loaded = np.append(fit.data.loaded, False)  # a baseline's state comes last
    pressed = loaded[here.state]
    change = np.nan_to_num(so - so[:, ~pressed].mean(1, keepdims=True))
    angle = fit.data.loads.angle[0, here.state[pressed]]
    shared = fit.place_shift(angle)
    shifts = np.zeros(len(angle)) if shared is None else shared[0]
    rows: list[tuple[Floats, ...]] = []
    states = [int(k) for k in np.flatnonzero(loaded)]
    for i, shift in zip(np.flatnonzero(pressed), shifts, strict=True):
        number = states.index(int(here.state[i]))
        k, m = (names.index(f"{kind}.{number}") for kind in (PLACE, PUSH))
        place, push = by[:, i, k], by[:, i, m]
        told = left[:, i] + place * (fit.constants[k] - shift) + push * fit.constants[m]
        size, scatter = fit.family.parts[k].size, fit.priors[names[m]].sd
        rows.append((change[:, i], told, here.sigma[:, i], place * size, push * scatter))
    own = here.state[pressed]
    force = np.nan_to_num(fit.data.loads.force).sum(0)[own]
    return Presses(angle + shifts, force, *(np.array(x) for x in zip(*rows, strict=True)))
