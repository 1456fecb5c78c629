"""Verdict of a log on its skin file: the number of it that is wrong, and by how much.

With r the residuals of single contacts, J and s their derivatives by the contact and by an
input m, W the weights, and s' = s - J (J^T W J)^-1 J^T W s what no contact explains::

    dm = sum s'^T W r / sum s'^T W s',    gain in chi2 = (sum s'^T W r)^2 / sum s'^T W s'
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from suas_jax.config.input_errors import STIFFNESS

FEWEST = 8
"""Single contacts that a verdict needs."""
GAIN = 25.0
"""Least gain in chi2 of an input that is named."""
LARGER = 1.2
"""Chi2 per degree of freedom that the model's own error may leave."""
_ALIKE = 0.02  # share of chi2 that tells no two inputs apart: the model's own error
USABLE = (
    "ok",
    "ok_drifted",
    "poor_fit",
    "model_mismatch",
    "imprecise",
    "ambiguous",
    "at_edge",
    "no_convergence",
)
"""Statuses of frames that say something about the skin file."""
WIDTH = "width of the contacts"
_COMMANDS = {
    "geometry.oil_gap": "suas fit sensor {skin} {log} --fit gap",
    "oil.relative_permittivity": "suas fit sensor {skin} {log} --fit permittivity",
    "electrodes.lsb": "suas fit sensor {skin} {log} --fit scale",
    "geometry.thickness": "suas fit sensor {skin} {log} --joint",
    STIFFNESS: "suas fit sensor {skin} {log} --joint",
}


_AT_REST = ("geometry.oil_gap", "oil.relative_permittivity", "electrodes.lsb")


@dataclass(frozen=True)
class ModelVerdict:
    """What a log says about its skin file."""

    chi2_per_dof: float  # over the frames that were looked at
    right: bool  # whether noise explains that
    name: str | None = None  # of the input that would explain it best; None where none does
    # of that input, relative; of WIDTH, the arc that they press [m]
    change: float = float("nan")
    error: float = float("nan")  # standard deviation of the change
    # chi2 per degree of freedom with that change; NaN of a stiffness, which none show
    explained: float = float("nan")
    shift: int = 0  # columns by which the taxels' readings are displaced; 0 where they are not
    others: "tuple[Gain, ...]" = ()  # inputs whose change explains the log as well

    @property
    def text(self) -> str:
        """The verdict in a sentence."""
        if self.right:
            return f"the skin file explains the log (chi2 per dof {self.chi2_per_dof:.2f})"
        begin = f"the skin file doesn't explain the log (chi2 per dof {self.chi2_per_dof:.2f})"
        if self.shift:
            return (
                f"{begin}; it would with the readings moved by {self.shift:+d} taxels: a "
                "column too many or missing, or another order "
                f"(chi2 per dof {self.explained:.2f})"
            )
        if self.name is None:
            return f"{begin}, and no single input of it would"
        would = "it would" if self.explained <= LARGER else "it would do so better"
        if self.name == WIDTH:
            arc = f"contacts that press an arc of some {1e3 * self.change:.0f} mm"
            return f"{begin}; {would} with {arc} (chi2 per dof {self.explained:.2f})"
        change = _changed(self.name, self.change, self.error)
        if np.isnan(self.explained):
            return (
                f"the measured forces or pressures ask for the {change}; the readings alone "
                "can't show it, and this log can't tell whether material, thickness, filling, "
                "mounting or temperature is behind it"
            )
        others = " or the ".join(_changed(x.name, x.change, x.error) for x in self.others)
        listed = f"; as well with the {others}" if others else ""
        if self.chi2_per_dof < LARGER:
            better = f"{self.explained:.2f} instead of {self.chi2_per_dof:.2f}"
            return f"the {change} would explain the log better (chi2 per dof {better}){listed}"
        return f"{begin}; {would} with the {change} (chi2 per dof {self.explained:.2f}){listed}"

    def command(self, skin: str, log: str, *, zeroed: bool = False) -> str:
        """What would set it right; empty where nothing is known to.

        `zeroed`: readings do not count from a baseline, and the skin has the numbers of a zero,
        which says nothing of readings at rest.
        """
        if self.shift:
            return f"compare the order of the taxels in {skin} with the wiring"
        if zeroed and self.name in _AT_REST:
            return (
                f"suas invert {skin} {log} --baseline FILE, from which readings count: a zero "
                "says nothing of readings at rest"
            )
        return _COMMANDS.get(self.name or "", "").format(skin=skin, log=log)


def _changed(name: str, change: float, error: float) -> str:
    """An input and its change, in words, to the first figure of the error."""
    table, _, key = name.rpartition(".")
    where = f"{key} in [{table}]" if table else name
    figures = int(np.clip(np.ceil(-np.log10(max(100 * error, 1e-9))), 1, 3))
    return f"{where} changed by {100 * change:+.{figures}f} +- {100 * error:.{figures}f} %"


class Gain(NamedTuple):
    """What a change of an input takes off chi2."""

    chi2: float  # by which it falls
    name: str  # of the input
    change: float  # of the input, in units of the slopes' own
    error: float  # its standard deviation


def verdict_of(named: list[Gain], chi2: float, dof: int) -> ModelVerdict:
    """The verdict that names the best of some inputs, and those that explain as much.

    The named inputs explain the log, the best first; chi2 is that of the frames as the file has
    it, `dof` its degrees of freedom.
    """
    best, left = named[0], chi2 - named[0].chi2
    equal = max(GAIN, _ALIKE * left)
    others = tuple(x for x in named[1:] if best.chi2 - x.chi2 < equal)
    stated = best.name, best.change, best.error
    return ModelVerdict(chi2 / dof, False, *stated, left / (dof - 1), others=others)


def gain_of(
    name: str, slopes: NDArray, weight: NDArray, residual: NDArray, jacobian: NDArray
) -> Gain:
    """The best change of an input, contacts fitted anew to first order.

    Slopes are those of the readings by the input [frame, channel], the jacobian is that by the
    contact [frame, parameter, channel]. Residuals are readings less the model's, weights
    inverse variances [frame, channel].
    """
    slopes = np.where((weight > 0) & np.isfinite(slopes), slopes, 0.0)
    top, size = 0.0, 0.0
    for w, r, s, j in zip(weight, residual, slopes, jacobian, strict=True):
        information = (j * w) @ j.T
        left = s - np.linalg.lstsq(information, (j * w) @ s, rcond=None)[0] @ j
        top, size = top + float(left @ (w * r)), size + float(left @ (w * left))
    if size <= 0:
        return Gain(0.0, name, 0.0, float("inf"))
    return Gain(top**2 / size, name, top / size, size**-0.5)
