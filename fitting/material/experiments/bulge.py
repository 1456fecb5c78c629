"""The bulge test of a clamped circular diaphragm: pressure over the apex's height."""

import dataclasses
from collections.abc import Sequence
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.material.data.errors import DataError
from fitting.material.experiments.measurements import Predictor, StressTest, homogeneous
from fitting.material.experiments.prediction import AbstractExperiment, mode_factors
from fitting.material.experiments.table_reader import Reader
from suas_jax.constitutive import AbstractLaw, inflated_diaphragm

# Newton steps in log e over log h. A step below the last is taken, too; what it leaves is its
# square, and the pressure is exact up to the square of that. Laws end at large stretches:
# where there is no bulge, the next is sought at a smaller one.
_NEWTON_STEPS, _LONGEST, _BACK, _LAST = 10, 0.5, -0.25, 1e-3


class Bulge(AbstractExperiment):
    """Points of a circular-diaphragm bulge test: pressure at a given apex height.

    A membrane is inflated to a given apex stretch, and its height follows. The apex stretch
    that gives the measured height h_i is found by Newton's method. Near it pressure follows
    height along

        log p = log p(e) + (d log p / d log h) (log h_i − log h(e)),

    exact, with exact derivatives in the constants, where h(e) = h_i.
    """

    sized_by: ClassVar = "height"
    height: Float[Array, " n"]  # apex height over the diaphragm's radius
    thickness: Float[Array, " n"]  # undeformed thickness over radius

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Pressures [Pa]; not a number where the law has no bulge of that height."""
        # What is differentiated once more, by the constants, is not the slope.
        known = jax.lax.stop_gradient(law)
        apex = self._apex(known)
        _, (slope_p, slope_h) = self._inflated(known, apex)
        log_p, log_h = self._at(law, apex)
        return self._pressure(log_p, log_h, slope_p / slope_h)

    def _apex(self, law: AbstractLaw) -> Float[Array, " n"]:
        """e, logarithms of the apex stretches that give the measured heights."""

        def going_on(state: tuple[Array, Array, Array]) -> Array:
            _, size, count = state
            return (size > _LAST) & (count < _NEWTON_STEPS)

        def newton(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            apex, _, count = state
            (_, log_h), (_, slope_h) = self._inflated(law, apex)
            step = (jnp.log(self.height) - log_h) / slope_h
            step = jnp.where(jnp.isfinite(step), jnp.clip(step, -_LONGEST, _LONGEST), _BACK)
            return apex * jnp.exp(step), jnp.max(jnp.abs(step)), count + 1

        # That of a spherical cap, which a neo-Hookean membrane stays below by as much.
        square = self.height**2
        guess = jnp.log1p(square) * (1.0 - 0.35 * jnp.exp(-square))
        first = guess, jnp.asarray(jnp.inf), jnp.asarray(0)
        apex, _, _ = jax.lax.while_loop(going_on, newton, first)
        return apex

    def _pressure(self, log_p: Array, log_h: Array, along: Array) -> Float[Array, " n"]:
        """Pressures at the measured heights, from those near to them."""
        miss = jnp.log(self.height) - log_h
        return jnp.where(jnp.abs(miss) < _LAST, jnp.exp(log_p + along * miss), jnp.nan)

    def _inflated(
        self, law: AbstractLaw, apex: Float[Array, " n"]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Pressure and height at the apex stretches as log p, log h; slopes in log e."""
        return jax.jvp(lambda e: self._at(law, e), (apex,), (apex,))

    def _at(self, law: AbstractLaw, apex: Float[Array, " n"]) -> tuple[Array, Array]:
        bulge = inflated_diaphragm(law, jnp.exp(apex), 1.0, self.thickness)
        return jnp.log(bulge.pressure), jnp.log(bulge.apex_height)


@dataclasses.dataclass(frozen=True)
class BulgeTest(StressTest):
    """Pressures of a bulge test; states and factors are those of a spherical cap."""

    thickness: np.ndarray  # undeformed thickness over the diaphragm's radius, shape [n]

    @property
    def height(self) -> np.ndarray:
        """Apex height over the diaphragm's radius, shape [n]."""
        return self.abscissa

    @property
    def deformation(self) -> np.ndarray:
        """The height."""
        return self.height

    def predictor(self, *, estimate: bool) -> Predictor:
        """Membranes; as a rough prediction, the apex of a spherical cap, whose stress is known.

        That has a pressure at every height, also where the law has no membrane of it.
        """
        return homogeneous if estimate else membranes


def membranes(tests: Sequence[BulgeTest]) -> Bulge:
    """Bulge tests as inflated membranes."""
    height = np.concatenate([test.height for test in tests])
    thickness = np.concatenate([test.thickness for test in tests])
    return Bulge(jnp.asarray(height), jnp.asarray(thickness))


def bulge(reader: Reader) -> BulgeTest:
    """Readings of a clamped circular diaphragm: pressure over the apex's relative height."""
    values = reader.needed("pressure", "the pressure", "pressure_kPa")
    height = reader.column("height")
    if height is None:
        height = reader.needed("displacement", "the apex height", "apex_height_mm")
    radius, thickness = reader.size("radius"), reader.size("thickness")
    if radius is None and (diameter := reader.size("diameter")) is not None:
        radius = 0.5 * diameter
    if radius is None or thickness is None:
        raise DataError(
            f"{reader.table.file}: a bulge test needs the diaphragm's radius and thickness: "
            f'add "# radius: 40 mm" and "# thickness: 1.5 mm" to the file or give '
            f'--specimen "radius=40 mm,thickness=1.5 mm"'
        )
    bad = np.flatnonzero(height < 0.0)
    if bad.size:
        index = reader.position("height")
        raise DataError(
            f"{reader.at(bad[0], index)}: {reader.table.texts[bad[0]][index]} is impossible: "
            f"the apex of an inflated diaphragm rises"
        )
    relative = height / radius
    flat = relative == 0.0
    if flat.any():
        reader.warnings.append(f"{flat.sum()} rows of a flat diaphragm left out")
        values = np.where(flat, np.nan, values)
        relative = np.where(flat, 1.0, relative)
    # The spherical cap of this height (Hill's special solution): stretch 1 + η² at the
    # apex, p = 4 σ η (T/a) / ((1 + η²) λ²).
    stretch = 1.0 + relative**2
    factors = mode_factors("equibiaxial", stretch)
    factors[2:] *= 4.0 * relative * thickness / radius / stretch**3
    own = {"coordinate": relative, "thickness": thickness / radius}
    return reader.stress_test(BulgeTest, "pressure", factors, values, **own)
