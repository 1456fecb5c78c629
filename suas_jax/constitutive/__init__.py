"""Material laws: a strain energy each, from which everything else is derived."""

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.laws.arruda_boyce import ArrudaBoyce
from suas_jax.constitutive.laws.gent import Gent
from suas_jax.constitutive.laws.mooney_rivlin import MooneyRivlin
from suas_jax.constitutive.laws.neo_hookean import NeoHookean
from suas_jax.constitutive.laws.ogden import Ogden
from suas_jax.constitutive.laws.polynomial import Polynomial
from suas_jax.constitutive.laws.yeoh import Yeoh
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
    "MODES",
    "AbstractLaw",
    "ArrudaBoyce",
    "Diaphragm",
    "Gent",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
    "Polynomial",
    "ShearStress",
    "Stress",
    "TubeResponse",
    "Yeoh",
    "balloon_pressure",
    "biaxial",
    "drucker_modulus",
    "equibiaxial",
    "inflated_diaphragm",
    "planar",
    "simple_shear",
    "stable_range",
    "tube",
    "uniaxial",
]
