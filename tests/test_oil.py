"""One contract for every oil model: its equation, its derivative, its declaration."""

import tomllib
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from suas_jax.config import (
    OILS,
    AeratedOilSpec,
    CompressibleOilSpec,
    IncompressibleOilSpec,
    OilSpec,
    VentedOilSpec,
    scene_from_dict,
)
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.registry import build_oil


class Case(NamedTuple):
    """A model and its closed form: the film's volume over its volume at rest."""

    spec: OilSpec
    ratio: Callable[[np.ndarray], np.ndarray]

    @property
    def oil(self) -> AbstractOil:
        """The model itself."""
        return build_oil(self.spec, lambda key: jnp.asarray(getattr(self.spec, key))[None])


CASES = {
    "aerated": Case(
        AeratedOilSpec(air_fraction=0.02, ambient_pressure=1.3e5, bulk_modulus=1.5e9),
        lambda p: 0.98 * np.exp(-p / 1.5e9) + 0.02 * 1.3e5 / (1.3e5 + p),
    ),
    "incompressible": Case(IncompressibleOilSpec(), lambda p: np.ones_like(p)),
    "compressible": Case(
        CompressibleOilSpec(bulk_modulus=1.5e9), lambda p: 1 + np.expm1(-p / 1.5e9)
    ),
    "vented": Case(VentedOilSpec(), lambda p: np.ones_like(p)),
}
PRESSURE = np.array([-2e4, -1.0, 0.0, 1.0, 1e4, 3e5])
FILM = 9e-4  # per width [m^2]


@pytest.fixture(params=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def test_every_model_has_a_case() -> None:
    assert {case.spec.model for case in CASES.values()} == set(OILS)


def test_volume_is_that_of_the_closed_form(case: Case) -> None:
    got = case.oil.expansion(jnp.asarray(PRESSURE), jnp.full(1, FILM))
    expected = FILM * (case.ratio(PRESSURE) - 1.0)
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-15 * FILM)
    assert got[PRESSURE == 0.0] == 0.0
    assert case.oil.yields == bool(np.any(expected))


def test_compliance_is_the_slope_of_the_volume(case: Case) -> None:
    got = case.oil.compliance(jnp.asarray(PRESSURE), jnp.full(1, FILM))
    step = 1e-30
    expected = FILM * np.imag(case.ratio(PRESSURE + 1j * step)) / step
    np.testing.assert_allclose(got, expected, rtol=1e-12)
    assert np.all(got <= 0.0)


@pytest.mark.parametrize("model", list(OILS))
def test_examples_of_the_declaration_are_a_model(model: str) -> None:
    fields = OILS[model].model_fields
    named = [k for k in fields if k != "fill" or OILS[model].trapped]
    table = tomllib.loads("\n".join(f"{k} = {fields[k].examples[0]}" for k in named))
    scene = {
        "geometry": {"inner_radius": "50 mm", "thickness": "1 mm", "half_angle": "90 deg"}
        | {"width": "100 mm", "oil_gap": "5 mm"},
        "material": {"law": "neo-hookean", "mu": "1 MPa"},
        "oil": table,
    }
    spec = scene_from_dict(scene).oil
    assert type(spec) is OILS[model]
    assert Case(spec, np.ones_like).oil.trapped == spec.trapped
