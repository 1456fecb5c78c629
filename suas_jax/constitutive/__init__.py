"""Material laws: a strain energy each, from which everything else is derived.

Each file of `laws` defines one, which can be imported from here, too (`Gent`, `Ogden` ...).
"""

from typing import Any

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.registry import LAWS, build_law
from suas_jax.constitutive.specimens.diaphragm import Diaphragm, inflated_diaphragm
from suas_jax.constitutive.specimens.homogeneous import (
    MODES,
    ShearStress,
    Stress,
    biaxial,
    equibiaxial,
    planar,
    simple_shear,
    uniaxial,
)
from suas_jax.constitutive.specimens.inflation import TubeResponse, balloon_pressure, tube
from suas_jax.constitutive.stability import drucker_modulus, stable_range

__all__ = [
    "LAWS",
    "MODES",
    "AbstractLaw",
    "Diaphragm",
    "ShearStress",
    "Stress",
    "TubeResponse",
    "balloon_pressure",
    "biaxial",
    "build_law",
    "drucker_modulus",
    "equibiaxial",
    "inflated_diaphragm",
    "planar",
    "simple_shear",
    "stable_range",
    "tube",
    "uniaxial",
]


def __getattr__(name: str) -> Any:
    for law in LAWS.values():
        if law.__name__ == name:
            return law
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
