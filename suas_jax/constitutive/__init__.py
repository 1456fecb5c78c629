"""Material laws: a strain energy each, from which everything else is derived."""

from .arruda_boyce import ArrudaBoyce
from .base import AbstractLaw
from .diaphragm import Diaphragm, inflated_diaphragm
from .gent import Gent
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
from .polynomial import Polynomial
from .stability import drucker_modulus, stable_range
from .yeoh import Yeoh

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
