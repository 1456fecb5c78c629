"""Checks of a data set: unloading branches, mistaken units, mistaken signs.

Nothing here changes data: what looks wrong becomes a warning with its reason.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.optimize

from fitting.material.experiments.measurements import PATHS, Dataset, StressTest, series_of
from fitting.material.experiments.selection import half_cycles

_SHORTEST_BRANCH = 3
_HIGHER = 0.02  # share by which a way back may lie above the way out
# Rubber: the stiffer the network, the shorter it stretches. Gum rubber has about
# μ λ² = 23 MPa at break, stiff filled ones 40 MPa.
_STIFF_AND_LONG = 60e6
_STIFF, _LONG = 3e6, 2.0
_SOFTEST = 100.0
_AT_REST = 1e-9
_JUMP = 6.0
# Of compression that is listed as positive: readings and strains that show it, the share of the
# largest stress that a tensile curve misses by, and how many times better the other sign is.
_FEWEST, _CLEARLY, _SHORTEST = 8, 0.1, 0.9
_MISSED, _BETTER = 0.02, 5.0


@dataclasses.dataclass(frozen=True)
class Branches:
    """Loading and unloading of one test, in the order of its rows."""

    unloading: np.ndarray  # readings on a branch that goes back, shape [n]
    loss: float  # mean of how much lower the stress is on the way back, relative


def branches(data: Dataset) -> Branches:
    """Find unloading branches in a test whose rows are in the order of time.

    A branch is a run of at least three steps towards rest that spans 5 % of the test, after one
    that went out over the same states, or before it. Rows in no order of time have no branches.
    """
    none = Branches(np.zeros(data.size, dtype=bool), 0.0)
    if not isinstance(data, StressTest) or not data.is_curve or data.size < 6:
        return none
    h = data.deformation
    unloading = np.zeros(data.size, dtype=bool)
    side = np.sign(data.unit_stress)
    for rows in series_of(data):
        halves = [(rows[half.rows], half.outward) for half in half_cycles(h[rows])]
        ends = [own[h[own].argmax()] for own, outward in halves if outward]
        for own, outward in halves:
            reached = h[[end for end in ends if side[end] == side[own[0]]]]
            if not outward and len(own) >= _SHORTEST_BRANCH and (reached > h[own[-1]]).any():
                unloading[own] = True
    if not unloading.any():
        return none
    out = ~unloading
    order = np.argsort(h[out])
    outwards = np.interp(h[unloading], h[out][order], np.abs(data.value[out][order]))
    usable = outwards > 0.05 * np.max(np.abs(data.value))
    if not usable.any():
        return none
    back = np.abs(data.value[unloading])
    return Branches(unloading, float(np.mean(1.0 - back[usable] / outwards[usable])))


def returns(data: StressTest) -> bool:
    """Whether some readings, or all of them, are of unloading."""
    return bool(branches(data).unloading.any()) or _only_returns(data)


def refuse_without_information(data: Dataset) -> None:
    """Raise a ValueError where every reading is at rest, or every reading is zero."""
    deformed = np.ones(data.size, bool)
    if isinstance(data, StressTest):
        deformed = np.abs(data.deformation) > _AT_REST
    if not np.any(deformed):
        raise ValueError(
            f"{data.file}: every reading is at rest: it says nothing about the material; "
            "check the columns, or leave the file out"
        )
    if not np.any(data.value[deformed] != 0.0):
        raise ValueError(
            f"{data.file}: the material is deformed, and every reading is zero; check the "
            "columns, or leave the file out"
        )
    if isinstance(data, StressTest) and data.mode in PATHS and np.mean(_opposed(data)) > 0.9:
        state, column = data.origin.state, data.origin.column
        ways = ""
        if state not in ("stretch", ""):  # which have no name for compression
            ways = f'--columns "compressive {state}={column}" where it was squeezed, or '
        if state == "displacement":  # of a crosshead that goes down as it pulls
            ways += f'"displacement={column} -1 {data.origin.unit}" where it was pulled, or '
        raise ValueError(
            f"{data.file}: stresses have the sign opposite to their strain, as no rubber's; "
            f"{ways}turn the sign of the stress or force by "
            f'its unit, such as --columns "force=NAME -1 N" or "stress=NAME -1 MPa"'
        )


def _opposed(data: StressTest) -> np.ndarray:
    """Which of the stresses that are not near zero pull where the material is squeezed."""
    size = np.abs(data.value)
    wrong = data.value * np.sign(data.unit_stress) < 0.0
    return wrong[size > 0.02 * np.max(size)]


def warnings_of(data: Dataset) -> list[str]:
    """What a person should look at in one data set."""
    found = [f"{data.file}: {text}" for text in data.warnings]
    if not isinstance(data, StressTest):
        return found
    path = branches(data)
    if path.unloading.any() and not data.follows_history:
        rows = data.line[path.unloading]
        are = "are an unloading branch"
        why = (
            "lower in stress than loading: hysteresis or softening (Mullins effect), which an "
            "elastic law can't follow; choose one branch with --branch loading"
        )
        if path.loss < -_HIGHER:
            are = "go back towards rest"
            why = (
                "higher in stress than those that go out, as no unloading of rubber: are the "
                "rows listed from the end of the test? Turn them round, as --branch loading "
                "would keep the unloading"
            )
        found.append(
            f"{data.file}: {path.unloading.sum()} readings (lines {rows.min()} to "
            f"{rows.max()}) {are}, {100.0 * abs(path.loss):.0f} % {why}"
        )
    if _only_returns(data):
        found.append(
            f"{data.file}: its readings go back towards rest as time goes on: an unloading "
            f"curve, which hysteresis and softening (Mullins effect) make lower than the "
            f"loading; fit the loading"
        )
    found += [f"{data.file}: {text}" for text in _unit_doubts(data)]
    if np.mean(_opposed(data)) > 0.5:
        found.append(
            f"{data.file}: most stresses have the sign opposite to their strain; compression "
            f"is a stretch below one (negative strain) with negative stress"
        )
    if _reads_as_compression(data):
        found.append(
            f"{data.file}: reads as compression with strains and stresses listed as positive: "
            f"if it is, name its columns so (--columns "
            f'"compressive strain=NAME, compressive stress=NAME")'
        )
    if data.dropped:
        what = ", ".join(f"{count} ({reason})" for reason, count in data.dropped.items())
        found.append(f"{data.file}: rows left out: {what}")
    return found


def _only_returns(data: StressTest) -> bool:
    """Whether the times of a specimen's readings say that its curve is all unloading."""
    if not data.is_curve or data.follows_history:
        return False
    for rows in series_of(data):
        time = data.time[rows]
        if np.isfinite(time).all() and np.ptp(time) > 0.0:
            h = data.deformation[rows[np.argsort(time, kind="stable")]]
            if not any(half.outward for half in half_cycles(h)):
                return True
    return False


def _reads_as_compression(data: StressTest) -> bool:
    """Whether rubber under strains of the other sign follows a tensile curve far better.

    Mooney and Rivlin's law, nominal: S = 2 (l - l^-2) (C1 + C2 / l), neither constant negative.
    Nobody pulls a specimen that is shorter than it is wide, either.
    """
    if (data.mode, data.measure) != ("uniaxial", "nominal") or data.size < _FEWEST:
        return False
    strain = data.stretch_1 - 1
    if np.min(strain) < -_AT_REST or not np.max(strain) < _SHORTEST:
        return False
    if data.origin.length < np.sqrt(data.origin.area):
        return True
    if np.max(strain) < _CLEARLY:
        return False

    def left(side: float) -> float:
        """Root-mean-square stress that the law leaves, over the largest."""
        stretch = 1 + side * strain
        unit = side * (stretch - stretch**-2)
        terms = np.stack([unit, unit / stretch], 1)
        constants = scipy.optimize.nnls(terms, data.value)[0]
        away = data.value - terms @ constants
        return float(np.sqrt(np.mean(away**2)) / np.max(np.abs(data.value)))

    return left(1.0) > max(_MISSED, _BETTER * left(-1.0))


def _unit_doubts(data: StressTest) -> list[str]:
    modulus = data.modulus
    longest = float(np.max(np.maximum(data.stretch_1, data.stretch_2)))
    doubts = []
    if np.isfinite(modulus) and modulus > 0.0:
        stiff = modulus * longest**2 > _STIFF_AND_LONG or (modulus > _STIFF and longest > _LONG)
        if stiff and data.mode in ("uniaxial", "equibiaxial", "pure_shear", "biaxial"):
            doubts.append(
                f"the unit is doubtful: a rubber of shear modulus {modulus / 1e6:.3g} MPa "
                f"does not usually stretch to {longest:.3g}; kgf/cm2 labelled MPa is "
                f"10.2 times too large"
            )
        elif modulus < _SOFTEST:
            doubts.append(
                f"the unit is doubtful: a shear modulus of {modulus:.3g} Pa is softer than "
                f"any rubber or gel"
            )
    return doubts + _jumps(data)


def _jumps(data: StressTest) -> list[str]:
    """Neighbouring readings whose stiffnesses can't belong to one curve."""
    if data.mode not in PATHS or data.size < 3:
        return []
    e1, unit = data.factors[0], data.unit_stress
    # Near rest a zero that is off by little changes the ratio by much.
    rows = np.flatnonzero(np.abs(e1) > 0.1 * np.max(np.abs(e1)))
    rows = rows[np.argsort(e1[rows], kind="stable")]
    stiffness = data.value[rows] / unit[rows]
    positive = (stiffness[1:] > 0.0) & (stiffness[:-1] > 0.0)
    ratio = np.where(positive, stiffness[1:] / np.where(positive, stiffness[:-1], 1.0), 1.0)
    change = np.abs(np.log(ratio))
    if not len(change) or np.max(change) < np.log(_JUMP):
        return []
    at = int(np.argmax(change))
    return [
        f"the unit is doubtful: from line {data.line[rows[at]]} to line "
        f"{data.line[rows[at + 1]]} the stiffness changes by a factor of "
        f"{np.exp(change[at]):.3g}; are there two units in one column, or a mistyped reading?"
    ]


def contradictions(sets: Sequence[Dataset]) -> list[str]:
    """Data sets whose initial stiffnesses don't belong to one material."""
    moduli = ((data, data.modulus) for data in sets if data.mode in (*PATHS, "biaxial"))
    known = [(data, modulus) for data, modulus in moduli if modulus > 0.0]
    if len(known) < 2:
        return []
    usual = float(np.median([modulus for _, modulus in known]))
    softest = min(known, key=lambda pair: pair[1])
    found = []
    for data, modulus in known:
        ratio = modulus / (softest[1] if len(known) == 2 else usual)
        if ratio > 3.0 or ratio < 1.0 / 3.0:
            times = ratio if ratio > 1.0 else 1.0 / ratio
            hint = "; kgf/cm2 labelled MPa makes a factor of 10.2" if 6.0 < times < 17.0 else ""
            found.append(
                f"{data.file}: the unit is doubtful: its initial stiffness is "
                f"{times:.3g} times {'above' if ratio > 1.0 else 'below'} that of the other "
                f"files{hint}"
            )
    return found
