"""Natural modes of a skin about a state, and up to which frequency statics is right.

With stiffness K, mass M and damping C of the unknowns u, on the motions that the oil's volume
allows::

    K phi = w^2 M phi,    zeta = phi' C phi / (2 w phi' M phi)

gives undamped frequencies and damping ratios; roots s of (s^2 M + s C + K) x = 0 how a free
motion swings and fades. The bandwidth is the frequency up to which, for any load, the error of
the static answer K^-1 f stays below 1 % in the energy norm::

    || K^1/2 (K + i w C - w^2 M)^-1 K^1/2 - 1 ||_2 <= 0.01

which counts the lag of an answer like an error of its size.
"""

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Complex, Float

from suas_jax.config import SceneSpec, with_solve
from suas_jax.config.law import LawSpec
from suas_jax.dynamics.inertia import Densities, Inertia, densities_of, inertia_of
from suas_jax.dynamics.motion import Motion, motion_of
from suas_jax.dynamics.pad import PadMotion, pad_inertia, pad_motion
from suas_jax.scene.solve import Solution, solve

STATIC_ERROR = 0.01
"""Error of the static answer at the bandwidth."""
MOST_MODES = 50
# Elements that leave errors of 1e-4: a wave of the highest mode takes about sixteen.
_FIRST_ELEMENTS, _ELEMENTS_A_MODE = 24, 8
_PAD_ELEMENTS = (20, 16)
# Modes that damped ones and the bandwidth are made of, beyond those wanted.
_MORE_MODES = 24


@dataclasses.dataclass(frozen=True)
class Modes:
    """Natural modes of a skin."""

    modes: list[dict[str, float | None]]  # one row each, SI units in the key names
    # below it the static answer is right to `STATIC_ERROR` [Hz]; None where no state was found,
    # or an unstable one
    bandwidth: float | None
    shapes: Float[np.ndarray, "mode *shape"]  # of each mode, as `motion.shapes` has them
    motion: Motion | PadMotion | None  # what they are modes of; None where no state was found
    solution: Solution  # the state
    status: str  # as of a solve, or "unstable"
    message: str  # what it means, or what is not counted

    def report(self) -> dict[str, Any]:
        """What `suas modes --json` prints."""
        return {
            "status": self.status,
            "message": self.message,
            "modes": self.modes,
            "bandwidth_Hz": self.bandwidth,
            "oil_pressure_Pa": self.solution.report["oil_pressure_Pa"],
            "min_gap_m": self.solution.report["min_gap_m"],
        }


def modes(scene: SceneSpec, count: int = 6) -> Modes:
    """Natural modes about the state that a scene's loads hold, or about rest.

    The modes are those of the shell, in plane strain with its first-order correction for
    transverse shear.

    Args:
        scene: with trapped oil, and with the densities and the viscosity.
        count: how many, the lowest first.

    Raises:
        ConfigError: the scene lacks a density or the viscosity.
        ValueError: its oil is vented, or the count is out of range.
        Float64Error: float64 is off.
    """
    if not 1 <= count <= MOST_MODES:
        raise ValueError(f"{count} modes; 1 to {MOST_MODES} can be asked for")
    scene.require_no_bodies("`modes`")
    scene.geometry.require_no_sheets("`modes`")
    if not scene.oil.trapped:
        raise ValueError(
            "vented oil flows through an outlet that no file describes; modes need trapped "
            'oil: set oil.model = "incompressible"'
        )
    densities = densities_of(scene)
    elements = scene.solve.elements or (
        _FIRST_ELEMENTS + _ELEMENTS_A_MODE * count
        if scene.geometry.dimension == 2
        else _PAD_ELEMENTS
    )
    solution = solve(with_solve(scene, model="shell", mesh=None, elements=elements))
    lost = functools.partial(Modes, [], None, np.zeros(0), None, solution)
    if not solution.converged:
        return lost(solution.report["status"], solution.report["message"])
    flat = scene.geometry.dimension == 2
    motion = motion_of(solution) if flat else pad_motion(solution)
    found = spectrum_of(motion, densities, count)
    if found is None:
        message = "The state is unstable: a motion grows by itself, and has no frequency."
        return lost("unstable", message)
    shapes = motion.shapes(found.vectors)
    message = relaxation_note(scene.material)
    return Modes(found.modes, found.bandwidth, shapes, motion, solution, "converged", message)


def relaxation_note(material: LawSpec) -> str:
    """What a rubber that relaxes does beside its modes; empty where it does not."""
    series = material.relaxation
    if series is None:
        return ""
    ends = sorted({min(series.tau), max(series.tau)})
    return (
        f"The rubber's relaxation is not counted: stiffness is the {material.response} one; "
        f"{100 * (1 - series.long_term_share):.2g} % of a stress fades in "
        f"{' to '.join(f'{tau:.3g}' for tau in ends)} s, and statics may be off by as much in "
        "cycles of about that length."
    )


class Spectrum(NamedTuple):
    """Natural modes of a motion."""

    modes: list[dict[str, float | None]]  # one row each, SI units in the key names
    vectors: Float[np.ndarray, "unknown mode"]  # their displacements, by the free unknowns
    bandwidth: float  # see `Modes` [Hz]


def spectrum_of(
    motion: Motion | PadMotion, densities: Densities, count: int
) -> Spectrum | None:
    """Natural modes of a motion in a fluid; None where a motion grows by itself.

    `motion`: about a state. `densities`: what moves.
    """
    if isinstance(motion, Motion):
        found = inertia_of(
            motion.outline, motion.moved, motion.section, motion.water, densities
        )
        inertia, omitted = jax.tree.map(np.asarray, found), motion.omitted
    else:
        inertia, omitted = pad_inertia(motion, densities), None
    squares, vectors = lowest_modes(motion, np.asarray(inertia.mass), count + _MORE_MODES)
    if squares[0] <= 0:
        return None
    if omitted is not None:
        # What the shell leaves out is a compliance, this share of a mode's own.
        softer = np.einsum("ki,kl,li->i", vectors, omitted, vectors) / squares
        squares = squares / (1 + softer)
    damping = vectors.T @ inertia.damping @ vectors
    rows = _rows(squares, damping, vectors, inertia)[:count]
    return Spectrum(rows, vectors[:, :count], bandwidth_of(squares, damping))


def lowest_modes(
    motion: Motion | PadMotion, mass: np.ndarray, count: int
) -> tuple[Float[np.ndarray, " mode"], Float[np.ndarray, "unknown mode"]]:
    """w^2 of the lowest undamped modes, and their displacements, of unit mass.

    Of the motions that keep the oil's volume, or of all with the stiffness of its oil.
    """
    stiffness, volume = np.asarray(motion.stiffness), np.asarray(motion.volume)
    if motion.compliance < 0:
        stiffness = stiffness - np.outer(volume, volume) / motion.compliance
        basis = np.eye(len(volume))
    else:
        basis = scipy.linalg.null_space(volume[None])
    size = min(basis.shape[1], count)
    allowed = (basis.T @ x @ basis for x in (stiffness, mass))
    vectors = basis @ scipy.linalg.eigh(*allowed, subset_by_index=[0, size - 1])[1]
    # Thin membranes stretch 1e12 times as stiffly as they bend: so large a matrix rounds the
    # lowest values by that factor, but the space of their modes hardly.
    squares, turned = scipy.linalg.eigh(*(vectors.T @ x @ vectors for x in (stiffness, mass)))
    return squares, vectors @ turned


def _rows(
    squares: np.ndarray, damping: np.ndarray, vectors: np.ndarray, inertia: Inertia
) -> list[dict[str, float | None]]:
    """The modes as a table.

    `squares`: w^2 of the undamped modes. `damping`: in their coordinates. `vectors`: of unit
    mass.
    """
    omega = np.sqrt(squares)
    film = np.einsum("ki,kl,li->i", vectors, inertia.film, vectors)
    rows: list[dict[str, float | None]] = []
    for i, root in enumerate(damped_roots(squares, damping)):
        rows.append(
            {
                "undamped_Hz": float(omega[i] / (2 * np.pi)),
                "damping_ratio": float(damping[i, i] / (2 * omega[i])),
                "frequency_Hz": float(root.imag / (2 * np.pi)) if root.imag > 0 else None,
                "time_s": float(-1 / root.real) if root.real < 0 else None,
                "film_share": float(film[i]),
            }
        )
    return rows


def damped_roots(
    squares: Float[np.ndarray, " mode"], damping: Float[np.ndarray, "mode mode"]
) -> Complex[np.ndarray, " mode"]:
    """For each undamped mode the root of the damped motion that is most like it.

    Of overdamped motions, which have two real roots each, the slower halves count.

    `squares`: w^2 of the modes. `damping`: in their coordinates.
    """
    n = len(squares)
    omega = np.sqrt(squares)
    # Unknowns w u and du/dt, so that both have one unit; 1/s, as rounding is relative to the
    # largest number, and slow motions are sought: fast ones of a thick oil are 1e14 as fast.
    viscous = damping / np.outer(omega, omega)
    once = np.diag(1 / omega)
    reciprocals, states = scipy.linalg.eig(np.block([[-viscous, -once], [once, 0 * once]]))
    roots = 1 / reciprocals
    swinging, real = roots.imag > 0, np.flatnonzero(roots.imag == 0)
    slower = real[np.argsort(-roots[real].real)[: len(real) // 2]]
    kept = np.concatenate([np.flatnonzero(swinging), slower])  # one a mode
    shapes = np.abs(states[:n, kept])
    likeness = shapes / np.linalg.norm(shapes, axis=0)
    _, own = scipy.optimize.linear_sum_assignment(-likeness)
    found: np.ndarray = roots[kept[own]]
    return found


def bandwidth_of(
    squares: Float[np.ndarray, " mode"], damping: Float[np.ndarray, "mode mode"]
) -> float:
    """Frequency up to which the static answer to any load is right to `STATIC_ERROR` [Hz].

    `squares`: w^2 of the modes. `damping`: in their coordinates.
    """
    omega = np.sqrt(squares)
    viscous = damping / np.outer(omega, omega)

    def excess(frequency: float) -> float:
        inverse = np.diag(1 - frequency**2 / squares) + 1j * frequency * viscous
        error = np.linalg.inv(inverse) - np.eye(len(squares))
        return float(np.linalg.norm(error, 2)) - STATIC_ERROR

    # At half of the lowest frequency inertia alone is an error of a third.
    found: float = scipy.optimize.brentq(
        excess, 0.0, omega[0] / 2, xtol=1e-30 * omega[0], rtol=1e-9
    )
    return found / (2 * np.pi)
