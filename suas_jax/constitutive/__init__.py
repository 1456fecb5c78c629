"""Material laws: a strain energy each, from which everything else is derived."""

from .base import AbstractLaw
from .diaphragm import Diaphragm, inflated_diaphragm
from .homogeneous import (
    MODES,
    ShearStress,
    Stress,
    biaxial,
    equibiaxial,
    planar,
    simple_shear,
    uniaxial,
)
from .inflation import TubeResponse, balloon_pressure, tube
from .mooney_rivlin import MooneyRivlin
from .neo_hookean import NeoHookean
from .ogden import Ogden
from .stability import drucker_modulus, stable_range
from .yeoh import Yeoh

__all__ = [
    "MODES",
    "AbstractLaw",
    "Diaphragm",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
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
