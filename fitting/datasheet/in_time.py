"""Figures that need no readings: creep, natural frequencies, and how far buckling is."""

import math
from typing import Any

import numpy as np
import scipy.linalg

from suas_jax.config import ConfigError, SkinSpec, with_inputs, with_solve
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.dynamics.modes import modes
from suas_jax.dynamics.motion import Motion, motion_of
from suas_jax.dynamics.pad import PadMotion, pad_motion
from suas_jax.scene.solve import solve

_AFTER = 1.0  # creep counts from this long after the press [s]
_MISMATCH = 1e-6  # of the membrane, at which the slope of the stiffness is taken
_ELEMENTS = {2: 32, 3: (20, 16)}


def creep(relaxation: RelaxationSpec, time: float) -> float:
    """Rise of displacements under a held force since one second after the press, a share.

    With the stress relaxing by G(t) = 1 - sum g_i (1 - exp(-t/tau_i)), displacements under a
    constant force follow the compliance J, the solution of ``integral G(t - s) dJ(s) = 1``::

        J(t) = 1 + sum_k (v.f_k)^2 (1 - exp(l_k t)) / -l_k

    with v_i = sqrt(g_i / tau_i), and l_k, f_k eigenvalues and vectors of v v' - diag(1/tau), at
    a time since the press [s]. That holds for a skin that nothing stresses at rest, whose
    displacements are small.
    """
    g, tau = (np.array(x, float) for x in (relaxation.g, relaxation.tau))
    v = np.sqrt(g / tau)
    rate, vectors = np.linalg.eigh(np.outer(v, v) - np.diag(1 / tau))
    share = (v @ vectors) ** 2 / rate

    def compliance(t: float) -> float:
        return 1 + float(share @ np.expm1(rate * t))

    return compliance(time) / compliance(_AFTER) - 1


def motion_figures(spec: SkinSpec) -> tuple[dict[str, float], str]:
    """Lowest frequency, damping and bandwidth by key; why there are none, or what they omit."""
    try:
        found = modes(spec.unloaded, 1)
    except ConfigError as error:
        missing = ", ".join(mistake.key for mistake in error.mistakes)
        return {}, f"the skin file states no {missing}"
    except ValueError as error:
        return {}, str(error)
    if found.bandwidth is None:
        return {}, found.message
    first = found.modes[0]
    return {
        "lowest_frequency_Hz": float(first["undamped_Hz"] or 0.0),
        "damping_ratio": float(first["damping_ratio"] or 0.0),
        "bandwidth_Hz": found.bandwidth,
    }, found.message


def buckling_mismatch(spec: SkinSpec) -> tuple[float, str]:
    """How much longer the membrane could be than its seat before it buckles at rest, a share.

    Linear buckling: of the motions that keep the oil's volume, K + m K' is singular at the
    smallest positive mismatch m along the arc, K' being the stiffness's slope by it. The skin
    names ``geometry.mounting``; beside the mismatch stands the reason where there is none.
    """
    if not spec.oil.trapped:
        return math.nan, "the oil is vented, so that nothing but the membrane holds the arch"
    scene = with_solve(
        spec.unloaded, model="shell", elements=_ELEMENTS[spec.geometry.dimension]
    )
    now = float(spec.geometry.mounting or 0.0)
    found = []
    for mounting in (now, now + _MISMATCH):
        changed = with_inputs(scene, {"geometry.mounting": mounting})
        solution = solve(changed)
        if not solution.converged:
            return math.nan, solution.report["message"]
        found.append(_motion(solution))
    own, basis = found[0], scipy.linalg.null_space(np.asarray(found[0].volume)[None])
    stiffness = basis.T @ np.asarray(own.stiffness) @ basis
    slope = basis.T @ np.asarray(found[1].stiffness - own.stiffness) @ basis / _MISMATCH
    try:
        inverse = scipy.linalg.eigh(-slope, stiffness, eigvals_only=True)[-1]
    except scipy.linalg.LinAlgError:
        return 0.0, ""  # the skin is unstable at rest
    return (1 / float(inverse), "") if inverse > 0 else (math.inf, "")


def _motion(solution: Any) -> Motion | PadMotion:
    flat = solution.scene.geometry.dimension == 2
    return motion_of(solution) if flat else pad_motion(solution)
