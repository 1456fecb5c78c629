"""The constants that a sensor calibration can find, by the names that people give them."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.config.input_errors import stresses_of

PERMITTIVITY, GAP, SCALE = "relative_permittivity", "oil_gap", "lsb"
STRAY, LAYERS = "stray", "layers"
FILL, MOUNTING, THICKNESS = "fill", "mounting", "thickness"
STIFFNESS = "stiffness"  # a factor on all stresses of the material
PLACE, AXIAL, PUSH = "place", "axial", "push"  # a press's errors: of its force relative
TOUCH, FORCE_ZERO = "touch", "force_zero"  # what is told of travel and force at no load
ZEROS = (TOUCH, FORCE_ZERO)
PRESS_ERRORS = {PLACE: "angle", AXIAL: "axial", PUSH: "force"}
"""What of a known load each of them moves."""
ALIASES = {"permittivity": PERMITTIVITY, "gap": GAP, "scale": SCALE}
DEFAULT = (PERMITTIVITY, GAP)
PATHS = {
    PERMITTIVITY: "oil.relative_permittivity",
    GAP: "geometry.oil_gap",
    SCALE: "electrodes.lsb",
    STRAY: "electrodes.stray",
    FILL: "oil.fill",
    MOUNTING: "geometry.mounting",
    THICKNESS: "geometry.thickness",
}
"""TOML paths of the constants. Layers are a sum over several keys."""
GAPS = ("global", "module", "taxel")
_MATERIAL = "material."
_VACUUM = 8.854e-12
_DIAMETER = 4e-3  # of a usual taxel [m]
_SMALL_FILL, _SMALL_MOUNTING = 0.03, 5e-3  # natural sizes: what these are judged against
_FORCE = 10.0  # of a usual press [N]


@dataclasses.dataclass(frozen=True)
class SensorConstant:
    """One constant to be calibrated."""

    name: str  # key of the skin file; of a material constant with its table
    unit: str  # SI unit, "1" for a number
    size: float  # natural size, SI
    positive: bool = True  # whether it is an exponential of its parameter; else it is linear
    floor: float = -np.inf  # the smallest value that there is, SI


@dataclasses.dataclass(frozen=True)
class SensorFamily:
    """The constants of a calibration and the bijection to dimensionless parameters.

    c = s exp(theta) for constants that are positive, c = s theta for the others, with the
    natural size s.
    """

    parts: tuple[SensorConstant, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the constants."""
        return tuple(part.name for part in self.parts)

    @property
    def units(self) -> tuple[str, ...]:
        """Their SI units."""
        return tuple(part.unit for part in self.parts)

    @property
    def size(self) -> int:
        """How many they are."""
        return len(self.parts)

    @property
    def sizes(self) -> np.ndarray:
        """Natural sizes, SI [p]."""
        return np.array([part.size for part in self.parts])

    @property
    def positive(self) -> np.ndarray:
        """Which are exponentials of their parameters [p]."""
        return np.array([part.positive for part in self.parts])

    @property
    def floors(self) -> np.ndarray:
        """Smallest values that there are, SI [p]."""
        return np.array([part.floor for part in self.parts])

    def constants(self, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Constants in SI units."""
        return jnp.asarray(self.sizes) * jnp.where(self.positive, jnp.exp(theta), theta)

    def unconstrained(self, constants: Float[Array, " p"]) -> Float[Array, " p"]:
        """Parameters from constants."""
        x = constants / self.sizes
        return jnp.where(self.positive, jnp.log(jnp.where(self.positive, x, 1.0)), x)


def is_gap(name: str) -> bool:
    """Whether a constant is a gap, of all taxels, a module or one taxel."""
    return name.split(".")[0] == GAP


def moves_membrane(name: str) -> bool:
    """Whether the membrane's shape under known forces depends on a constant.

    It does on the gap, too, where the oil yields or takes another volume than the film's.
    """
    return name.startswith((_MATERIAL, "geometry.thickness.")) or name in (
        FILL,
        MOUNTING,
        THICKNESS,
        STIFFNESS,
        *ZEROS,
    )


def is_press_error(name: str) -> bool:
    """Whether a constant is the error of a press's place or force."""
    return name.split(".")[0] in PRESS_ERRORS


def with_constants(
    spec: SkinSpec, inputs: Mapping[str, Any], names: Iterable[str], values: Iterable[Any]
) -> dict[str, Any]:
    """Inputs by TOML path with constants in their places.

    The inputs come without the constants; a stiffness is a factor on what they have. Names and
    values are those of the constants, SI; gaps of single taxels, errors of places and zeros of
    gauges are no inputs.
    """
    found = dict(inputs)
    for name, value in zip(names, values, strict=True):
        if name == STIFFNESS:
            found |= {path: value * inputs[path] for path in stresses_of(spec)}
        elif not (is_press_error(name) or name in ZEROS or name.startswith(f"{GAP}.")):
            found[PATHS.get(name, name)] = value
    return found


def naming(spec: SkinSpec, names: Iterable[str]) -> SkinSpec:
    """A skin whose file names its filling and mounting where they are to be found.

    Raises ValueError: its oil is vented, so it has no filling.
    """
    own = {ALIASES.get(name.strip(), name.strip()) for name in names}
    tables: dict[str, Any] = {}
    if FILL in own and spec.oil.fill is None:
        if not spec.oil.trapped:
            raise ValueError(f"--fit {FILL}: vented oil flows freely, it has no filling")
        tables["oil"] = spec.oil.model_copy(update={FILL: 1.0})
    if MOUNTING in own and spec.geometry.mounting is None:
        tables["geometry"] = spec.geometry.model_copy(update={MOUNTING: 0.0})
    return spec.model_copy(update=tables)


def law_constants(spec: SkinSpec) -> list[str]:
    """TOML paths of the constants of the law itself; density and expansion are none."""
    heads = tuple(_MATERIAL + key for key in spec.material.declared())
    return [k for k in continuous_inputs(spec) if ".".join(k.split(".")[:2]) in heads]


def named(spec: SkinSpec, name: str) -> SensorConstant:
    """The constant of a skin that a name stands for.

    Raises ValueError: there is none; names those that there are.
    """
    own = ALIASES.get(name.strip(), name.strip())
    gap, permittivity = spec.geometry.mean_gap, spec.oil.relative_permittivity or 2.0
    if own in (GAP, THICKNESS) and not isinstance(getattr(spec.geometry, own), float):
        raise ValueError(
            f"--fit {name}: geometry.{own} is a table, not one number that can be found; "
            "write its mean as one length, fit other constants, or all with --fit as-built"
        )
    known: dict[str, tuple[Any, ...]] = {
        PERMITTIVITY: ("1", permittivity),
        GAP: ("m", gap),
        SCALE: ("F", spec.sensing.lsb),
        # Of the order of a taxel's own capacitance.
        STRAY: ("F", _VACUUM * permittivity * _DIAMETER**2 / gap, False, 0.0),
        LAYERS: ("m", gap / permittivity, False, 0.0),
        FILL: ("1", _SMALL_FILL, False),
        MOUNTING: ("1", _SMALL_MOUNTING, False),
        THICKNESS: ("m", spec.geometry.mean_thickness),
        STIFFNESS: ("1", 1.0),
        TOUCH: ("m", gap, False),
        FORCE_ZERO: ("N", _FORCE, False),
    }
    if own in known:
        return SensorConstant(own, *known[own])
    inputs = continuous_inputs(spec)
    if own.startswith(("geometry.thickness.value.", "geometry.oil_gap.value.")):
        return SensorConstant(own, "m", inputs[own])
    if own.startswith("electrodes."):
        return SensorConstant(own, "1", inputs[own])
    material = {path: inputs[path] for path in law_constants(spec)}
    if own not in material:
        what = "is found alone" if name == "relaxation" else "unknown"
        raise ValueError(
            f'--fit "{name}": {what}; allowed: as-built or relaxation alone, or any of '
            "permittivity, gap, scale, stray, layers, fill, mounting, thickness, touch, "
            "force_zero, " + ", ".join(material)
        )
    value = material[own]
    size = abs(value) or max(abs(v) for v in material.values())
    unit = spec.material.unit(own.removeprefix(_MATERIAL))
    return SensorConstant(own, unit, size, value > 0)


def starting_values(
    parts: Iterable[SensorConstant], stated: Iterable[float | None]
) -> np.ndarray:
    """What the skin file says of constants, else their natural size or zero, SI [p]."""
    return np.array(
        [
            value if value is not None else part.size if part.positive else 0.0
            for part, value in zip(parts, stated, strict=True)
        ]
    )


def single_gaps(
    spec: SkinSpec, parts: tuple[SensorConstant, ...], gaps: str
) -> tuple[tuple[SensorConstant, ...], tuple[int, ...] | None]:
    """Constants with a gap for each module or taxel, and which of them a taxel has.

    Raises ValueError: `gaps` is none of GAPS.
    """
    if gaps not in GAPS:
        raise ValueError(f"--gap {gaps}: unknown; allowed: {', '.join(GAPS)}")
    shared = [part for part in parts if part.name == GAP]
    if gaps == "global" or not shared:
        return parts, None
    modules, numbers = spec.sensing.taxel_names
    keys = [
        f"{GAP}.{m}" if gaps == "module" else f"{GAP}.{m}.{k}"
        for m, k in zip(modules, numbers, strict=True)
    ]
    own = list(dict.fromkeys(keys))
    others = tuple(part for part in parts if part.name != GAP)
    single = tuple(dataclasses.replace(shared[0], name=key) for key in own)
    return others + single, tuple(len(others) + own.index(key) for key in keys)
