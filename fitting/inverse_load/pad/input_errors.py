"""Errors of a pad's inputs: what they do to its readings and to the oil's pressure.

Nothing is solved in a frame. With u = 1 / (SO - stray) = a + b w, w the membrane's
displacement over a taxel, an error of gap, permittivity, layers or scale moves a and b, which
the readings at rest tell; one of the membrane is a change of stiffness, which does what the
loads' decrease does, at more pressure::

    dSO = dstray - (SO - stray)^2 (da + (db / b) (u - a)) - n sum_c F_c dSO/dF_c
    dp = n (p - sum_c F_c dp/dF_c)

n is the relative change of stiffness: that of the shear modulus for a constant of the
material; for a dimension it is what a few solved states show, and the part of its effect that
is no change of stiffness is left out.
"""

import functools
from collections.abc import Mapping

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.pad.rest import film_readings, stray_counts
from fitting.inverse_load.pad.table import PadTable
from suas_jax.config import InputErrors, SkinSpec, continuous_inputs
from suas_jax.config.input_errors import value_of
from suas_jax.files.kept_arrays import kept_arrays
from suas_jax.runtime.content_key import content_key, source_digest
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin, skin_of

_PLACE_ERROR, _FORCE_ERROR = 5e-5, 5e-3  # standard deviations [m], of the force
_WIDE_PLACE, _WIDE_FORCE = (
    0.02,
    2.0,
)  # those by extent beyond the table's disc, the latter [1/m]
_STEP = 0.02  # of the force in solved states, relative
_SMALL = 1e-3  # of a standard deviation, for derivatives at rest
_GAP = "geometry.oil_gap"
_ELECTRICAL = ("electrodes.", "oil.relative_permittivity", _GAP)
_PROBES = ((0.0, 0.0), (0.4, 0.4))  # places of the solved states, shares of the pad's edges
_LOADED = 0.4  # force of the solved states, as a share of the table's largest


class PadErrors(AbstractSystematicErrors):
    """Errors of a pad's inputs, and what its model and mesh leave open.

    Against continuum and finer meshes the force is within half a per cent and the place
    within a twentieth of a millimetre: taken as standard deviations. What the sum of discs
    leaves out of contacts 20 to 45 mm long is up to a tenth of the force.

    Args:
        errors: of its inputs.
        skin: the model made from it.
        table: its states.
        from_rest: whether readings count from a baseline.
        slots: contacts that the program for solved states has room for.
    """

    def __init__(
        self,
        errors: InputErrors,
        skin: Skin,
        table: PadTable,
        *,
        from_rest: bool,
        slots: int,
    ) -> None:
        self.names = errors.names
        self._spec, self._skin, self._table, self._slots = errors.spec, skin, table, slots
        self._inputs = continuous_inputs(errors.spec)
        self._radius = float(skin.geometry.outer_size[0])
        taxels, count = len(table.rest), len(errors)
        self._stray = table.stray
        self._at_rest = 1 / (table.rest - table.stray)
        self._by_stray = np.zeros((count, taxels))
        self._constant = np.zeros((count, taxels))  # da
        self._relative = np.zeros((count, taxels))  # db / b
        self._stiffness = np.zeros(count)
        sizes = np.abs(errors.directions).max(0, initial=0.0)
        self._sizes = dict(zip(errors.paths, sizes.tolist(), strict=True))
        for e, direction in enumerate(errors.directions):
            change = dict(zip(errors.paths, direction.tolist(), strict=True))
            change = {path: size for path, size in change.items() if size}
            electrical = {p: s for p, s in change.items() if p.startswith(_ELECTRICAL)}
            if electrical:
                self._read_at_rest(e, electrical)
            self._stiffness[e] = self._stiffening(
                {p: s for p, s in change.items() if p not in electrical}
            )
        rest = self._by_stray - self._constant / self._at_rest**2
        zero = np.zeros((count, 1))
        self._moved_at_rest = np.concatenate([rest, zero], 1)
        self.rest = 0 * self._moved_at_rest if from_rest else self._moved_at_rest

    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """See the base class."""
        del per_contact
        forces = slice(2 * contacts, 3 * contacts)
        along = (best.parameters[:, forces, None] * best.jacobian[:, forces]).sum(1)
        so = best.so[:, :-1]
        u = 1 / np.maximum(so - self._stray, 1e-9)
        change = self._constant + self._relative * (u - self._at_rest)[:, None]
        electrical = self._by_stray - change / u[:, None] ** 2
        own = np.concatenate([electrical, np.zeros((*electrical.shape[:2], 1))], 2)
        stiffer = -along
        stiffer[:, -1] += best.pressure
        moved = own + self._stiffness[:, None] * stiffer[:, None]
        return np.asarray(moved - self._moved_at_rest + self.rest)

    def unexplained(self, best: Explanations, per_contact: int) -> Floats | None:
        """See the base class: errors of the model and its mesh."""
        total = np.full(best.information.shape, np.nan)
        for i, count in enumerate(best.contacts.tolist()):
            width = per_contact * count
            own = best.parameters[i, :width].reshape(per_contact, count)
            sigma = np.zeros_like(own)
            longest = np.nan_to_num(best.beside[i, :count, :2, 0]).max(-1, initial=0.0)
            longer = np.maximum(longest - self._table.diameter, 0.0)
            sigma[1] = np.hypot(_PLACE_ERROR, _WIDE_PLACE * longer)
            sigma[0] = sigma[1] / self._radius
            sigma[2] = np.hypot(_FORCE_ERROR, _WIDE_FORCE * longer) * own[2]
            total[i, :width, :width] = np.diag(sigma.reshape(-1) ** 2)
        return total

    # --- what errors of single inputs do ------------------------------------------------

    def _read_at_rest(self, e: int, change: Mapping[str, float]) -> None:
        """Derivatives of the readings at rest along a change of electrical inputs."""
        low, high = (self._gap_line(change, side * _SMALL) for side in (-1.0, 1.0))
        by_stray, constant, slope = (
            (b - a) / (2 * _SMALL) for a, b in zip(low, high, strict=True)
        )
        _, _, own = self._gap_line(change, 0.0)
        self._by_stray[e], self._constant[e] = by_stray, constant
        self._relative[e] = slope / own

    def _gap_line(
        self, change: Mapping[str, float], size: float
    ) -> tuple[Floats, Floats, Floats]:
        """Stray counts, a and b, with inputs changed by a share of an error [taxel]."""
        inputs = {path: value_of(self._spec, path) + size * by for path, by in change.items()}
        return gap_line(self._spec, inputs)

    def _stiffening(self, change: Mapping[str, float]) -> float:
        """Relative change of the membrane's stiffness along a change of inputs."""
        if not change:
            return 0.0
        material = {p: s for p, s in change.items() if p.startswith("material.")}
        total = 0.0
        if material:
            moduli = []
            for side in (-1.0, 1.0):
                inputs = {
                    p: value_of(self._spec, p) + side * _SMALL * s for p, s in material.items()
                }
                law = skin_of(self._spec, inputs, contact=False).law
                moduli.append(float(np.ravel(law.shear_modulus)[0]))
            total += (moduli[1] - moduli[0]) / (_SMALL * (moduli[0] + moduli[1]))
        for path, size in change.items():
            if path not in material:
                total += self._solved_stiffening(path, size)
        return total

    def _solved_stiffening(self, path: str, change: float) -> float:
        """Relative change of stiffness by a change of another input, from solved states.

        In proportion to the largest change of it that any error makes, which is solved.
        """
        size = self._sizes[path]
        name = content_key(
            {
                "path": path,
                "size": size,
                "inputs": self._inputs,
                "electrodes": repr(self._spec.electrodes),
                "elements": self._skin.elements,
                "diameter": self._table.diameter,
                "source": source_digest(),
            }
        )
        kept = kept_arrays(name, lambda: {"change": self._stiffer(path, size)})
        return float(kept["change"]) * change / size

    def _stiffer(self, path: str, size: float) -> float:
        changed = skin_of(
            self._spec,
            {path: value_of(self._spec, path) + size},
            elements=self._skin.elements,
            contact=False,
        )
        top = norm = 0.0
        for loads, own in self._probed:
            moved = solved_channels(changed, loads[:1], self._table.diameter, self._slots)
            lighter = (own[1] - own[0])[:-1]  # what so much more stiffness does
            by = (moved[0] - own[0])[:-1]
            used = np.isfinite(lighter) & np.isfinite(by)
            top += float(by[used] @ lighter[used])
            norm += float(lighter[used] @ lighter[used])
        return _STEP * top / norm if norm > 0 else 0.0

    @functools.cached_property
    def _probed(self) -> list[tuple[Floats, Floats]]:
        """Loads of the solved states, and what they read on the skin as its file has it."""
        middle = [len(x) // 2 for x in (self._table.angle, self._table.axial)]
        force = _LOADED * float(self._table.cap[middle[0], middle[1]])
        found = []
        for a, z in _PROBES:
            place = a * self._table.angle[-1], z * self._table.axial[-1]
            loads = np.array([[*place, force], [*place, (1 - _STEP) * force]])
            own = solved_channels(self._skin, loads, self._table.diameter, self._slots)
            found.append((loads, own))
        return found


def gap_line(spec: SkinSpec, inputs: Mapping[str, float]) -> tuple[Floats, Floats, Floats]:
    """Stray counts, a and b of 1 / (SO - stray) = a + b w [taxel], w from the undeformed pad.

    Args:
        spec: the pad.
        inputs: electrical ones that replace its own, by TOML path.
    """
    own = {**continuous_inputs(spec), **inputs}
    gaps = {p: x for p, x in own.items() if p == _GAP or p.startswith(f"{_GAP}.value.")}
    step = 1e-4 * spec.geometry.mean_gap
    values = []
    for shift in (-step, 0.0, step):
        moved = {path: gap + shift for path, gap in gaps.items()}
        skin = skin_of(spec, {**inputs, **moved}, contact=False)
        stray = stray_counts(skin)
        values.append(1 / (film_readings(skin) - stray))
    return stray, values[1], (values[2] - values[0]) / (2 * step)


def solved_channels(skin: Skin, parameters: Floats, diameter: float, slots: int) -> Floats:
    """Readings and the oil's pressure under single contacts, from the model.

    Args:
        skin: the pad.
        parameters: angle, axial position and force, and a diameter where it is estimated
            [frame, parameter].
        diameter: of the contacts else [m].
        slots: contacts that the program has room for.

    Returns:
        Channels [frame, channel]; NaN where no state was found.
    """
    rows = []
    for x in parameters:
        size = x[3] if len(x) > 3 else diameter
        unused = [[*x[:2], 0.0, size]] * (slots - 1)
        columns = np.array([[*x[:3], size], *unused]).T
        found = forward(skin, Loads.patch(*columns[..., None]))
        row = np.append(np.asarray(found.so)[:, 0], np.asarray(found.oil_pressure))
        rows.append(row if bool(found.solved[0]) else np.full_like(row, np.nan))
    return np.array(rows)
