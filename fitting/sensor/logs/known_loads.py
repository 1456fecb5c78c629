"""Known loads of an experiment: their place, and force, displacement or a body's travel."""

import dataclasses
from collections.abc import Callable

import numpy as np

AMOUNTS = "force", "displacement", "depth"
"""What a load is known by."""
WHERE = {"place": "angle", "direction": "turn"}
"""What else is told of a line load [rad], and where it stands."""
_STEP = 1e-3  # of the largest one, over which derivatives are taken
_TURNED = 5e-3  # the same of a place or direction [rad]


@dataclasses.dataclass(frozen=True)
class KnownLoads:
    """What is known of the loads, state by state."""

    angle: np.ndarray  # where they act, as sections define angles [load, state, rad]
    # of the force from the inward radial, counter-clockwise [load, state, rad]
    turn: np.ndarray
    # total over the width [load, state, N]; NaN where the displacement is known
    force: np.ndarray
    # of the material point under the load, along the load's direction [load, state, m]; NaN
    # where the force is known
    displacement: np.ndarray
    # whether the displacement is the inner face's; else the mid-surface's [load]
    inner: np.ndarray
    axial: np.ndarray  # where they act, from the middle of a pad [load, state, m]
    # of round contacts on a pad [load, state, m]; zero where it is not known
    diameter: np.ndarray
    # travel of a rigid body beyond first touch [load, state, m]; zero off the skin
    depth: np.ndarray
    # of a body: a cylinder on a section, a ball on a pad [load, state, m]; zero where loads are
    # no bodies
    radius: np.ndarray

    @classmethod
    def pushes(
        cls, angle: np.ndarray, force: np.ndarray, axial: np.ndarray | None = None
    ) -> "KnownLoads":
        """Radial loads of known force; see the fields.

        Forces are inwards; loads act at angles, and on a pad at axial positions, its middle if
        None.
        """
        zero, inner = np.zeros_like(force), np.zeros(len(force), bool)
        axial = zero if axial is None else axial
        return cls(angle, zero, force, zero + np.nan, inner, axial, zero, zero, zero)

    @property
    def bodies(self) -> bool:
        """Whether the loads are bodies."""
        return bool(self.radius.any())

    @property
    def states(self) -> int:
        """Number of states."""
        return self.angle.shape[1]

    def take(self, index: np.ndarray) -> "KnownLoads":
        """Some of the states."""
        return self._by_state(lambda values: values[:, index])

    def shifted(self, name: str, change: np.ndarray) -> "KnownLoads":
        """The same with another first load.

        What changes is named "angle", "axial" or "force"; the change is SI [state].
        """
        moved = getattr(self, name).copy()
        moved[0] += change
        return dataclasses.replace(self, **{name: moved})

    @property
    def known_by(self) -> dict[str, np.ndarray]:
        """Where a load is known by its force, displacement or depth [load, state].

        None of them where nothing is pressed, which is exact.
        """
        told = {name: np.nan_to_num(getattr(self, name)) != 0 for name in AMOUNTS}
        return told | {"depth": self.depth > 0}

    @property
    def pressed(self) -> np.ndarray:
        """Where a load presses [load, state]."""
        return np.any(list(self.known_by.values()), axis=0)

    def stepped(self, load: int) -> tuple["KnownLoads", np.ndarray]:
        """The same with a load a little further, and by how much [state] [N] or [m]."""
        changed, step = {}, np.zeros(self.states)
        for name, told in self.known_by.items():
            values = getattr(self, name).copy()
            own = np.where(told[load], _STEP * np.abs(values[told]).max(initial=0.0), 0.0)
            values[load] += own
            changed[name] = values
            step += own
        return dataclasses.replace(self, **changed), step

    def turned(self, load: int, name: str) -> tuple["KnownLoads", np.ndarray]:
        """The same with a load's place or direction changed, and by how much [state] [rad]."""
        values = getattr(self, WHERE[name]).copy()
        # Towards the middle, as none is beyond the clamps.
        step = np.where(self.pressed[load], np.where(self.angle[load] > 0, -1, 1), 0) * _TURNED
        values[load] += step
        return dataclasses.replace(self, **{WHERE[name]: values}), step

    def told(self, columns: int) -> dict[str, np.ndarray]:
        """What is told of the loads and may be wrong, where it counts [column, state].

        The columns are amounts, load after load, and then, if there are more, places and
        directions.
        """
        loads = len(self.angle)
        masks = {name: (0, mask) for name, mask in self.known_by.items()}
        if columns > loads:
            masks |= {name: (k, self.pressed) for k, name in enumerate(WHERE, 1)}
        return {
            name: np.pad(mask, ((k * loads, columns - (k + 1) * loads), (0, 0)))
            for name, (k, mask) in masks.items()
        }

    def zeros(self, travel: float, force: float) -> np.ndarray:
        """Errors of what was told where gauges show this at no load [load, state]."""
        told = self.known_by
        moved = told["displacement"] | told["depth"]
        return np.asarray(np.where(moved, travel, np.where(told["force"], force, 0.0)))

    def less(self, error: np.ndarray) -> "KnownLoads":
        """The loads without an error of what was told of them [load, state] [N] or [m]."""
        rest = {
            name: getattr(self, name) - np.where(told, error, 0.0)
            for name, told in self.known_by.items()
        }
        rest["depth"] = np.maximum(rest["depth"], 0.0)
        return dataclasses.replace(self, **rest)

    def with_rest(self) -> "KnownLoads":
        """One more state, without loads."""
        more = self._by_state(lambda values: np.pad(values, ((0, 0), (0, 1))))
        more.displacement[:, -1] = np.nan
        more.radius[:, -1] = self.radius.max(1, initial=0.0)
        return more

    def _by_state(self, change: Callable[[np.ndarray], np.ndarray]) -> "KnownLoads":
        """The same loads in other states."""
        names = (field.name for field in dataclasses.fields(self) if field.name != "inner")
        return dataclasses.replace(
            self, **{name: change(getattr(self, name)) for name in names}
        )
