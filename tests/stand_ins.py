"""Stand-ins for what a whole estimate would compute: formulas are tested without a model."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from fitting.inverse_load.fit.explanation import (
    AbstractLoadFitter,
    Attempt,
    Explanations,
    widened,
)
from fitting.inverse_load.model.contact_parameters import SECTION
from fitting.inverse_load.search.base import AbstractNodeSearch, PairSearch
from fitting.material.experiments.measurements import Origin, StressTest
from fitting.material.experiments.prediction import mode_factors
from fitting.steps import Steps
from suas_jax.equilibrium.equilibrium import State


def explanations(
    parameters: ArrayLike,  # [frame, parameter]
    *,
    contacts: ArrayLike = 1,  # their number [frame]
    so: ArrayLike | None = None,  # the model's readings [frame, taxel]; zero if None
    jacobian: ArrayLike | None = None,  # [frame, parameter, taxel]; zero if None
    weight: ArrayLike = 1.0,  # inverse variances [frame, taxel]
    chi2: ArrayLike = 1.0,  # of the fits [frame]
    **fields: Any,
) -> Explanations:
    """Explanations of frames with these values; their information is J^T W J.

    **fields: what else differs from zero; NaN is what is beside, and the score is chi2.
    """
    x = np.atleast_2d(np.asarray(parameters, float))
    frames, width = x.shape
    slopes = None if jacobian is None else np.array(jacobian, float)
    readings = None if so is None else np.atleast_2d(np.asarray(so, float))
    if readings is None:
        readings = np.zeros((frames, 1 if slopes is None else slopes.shape[2]))
    taxels = readings.shape[1]
    if slopes is None:
        slopes = np.zeros((frames, width, taxels))
    weights = np.broadcast_to(np.asarray(weight, float), (frames, taxels)).copy()
    squares = np.broadcast_to(np.asarray(chi2, float), frames).copy()
    information = (slopes * weights[:, None]) @ np.swapaxes(slopes, 1, 2)
    given: dict[str, Any] = {
        "score": squares.copy(),
        "chi2": squares,
        "contacts": np.broadcast_to(np.asarray(contacts), frames).copy(),
        "parameters": x.copy(),
        "jacobian": slopes,
        "information": information,
        "predicted_decrease": np.zeros(frames),
        "pressure": np.zeros(frames),
        "min_gap": np.ones(frames),
        "so": readings.copy(),
        "q": np.zeros((frames, 0, 0)),
        "weight": weights,
        "shift": np.zeros(readings.shape),
        "beside": np.full((frames, 3, 1, 2), np.nan),
        "eliminated": np.zeros((frames, 1, taxels)),
        "held": slopes.copy(),
    }
    return Explanations(**{**given, **fields})


TAXELS = np.linspace(-0.6, 0.6, 13)
"""Angles of the stand-in skin's taxels [rad]."""
AT_REST = np.full(13, 1e3)
STEEPNESS = 0.12  # width of what a contact does [rad]


def dimple_readings(
    parameters: ArrayLike,  # all angles [rad], all forces [N] [frame, parameter]
    contacts: int = 1,  # their number
) -> np.ndarray:
    """Readings [frame, taxel] of a skin whose gaps add up: 1 / SO = 1e-3 - 1e-5 F dimple."""
    x = np.atleast_2d(np.asarray(parameters, float))
    angle, force = x[:, :contacts, None], x[:, contacts : 2 * contacts, None]
    dimple = np.exp(-0.5 * ((TAXELS - angle) / STEEPNESS) ** 2)
    return np.asarray(1 / (1e-3 - 1e-5 * (force * dimple).sum(1)))


class DimpleFitter(AbstractLoadFitter):
    """Least squares on the stand-in skin, by SciPy."""

    parameters = SECTION
    edge = np.array([0.55])
    limit_error = 0.01
    beside = ("spread",)

    def __init__(self, *, live: bool = False, most_contacts: int = 3) -> None:
        self.live, self._most, self.fits = live, most_contacts, 0

    def steps(self, asked: Attempt) -> Steps[Explanations]:
        """Fit frames one by one."""
        y, weight, start, _, contacts, pull = asked
        yield f"fit of {contacts}"
        self.fits += 1
        assert np.shape(start) == (len(y), 2 * contacts)
        rows = []
        for k in range(len(y)):
            root = np.sqrt(weight[k])
            most = [*self.edge.repeat(contacts), *[0.0 if pull else 60.0] * contacts]
            least = [*-self.edge.repeat(contacts), *[-30.0 if pull else 0.0] * contacts]
            wanted = np.where(weight[k] > 0, y[k], 0.0)

            def residual(x: np.ndarray, wanted: Any = wanted, root: Any = root) -> np.ndarray:
                return np.asarray(root * (dimple_readings(x, contacts)[0] - wanted))

            begin = np.clip(start[k, : 2 * contacts], np.add(least, 1e-9), np.add(most, -1e-9))
            found = least_squares(
                residual,
                begin,
                bounds=(least, most),
                x_scale=[0.1] * contacts + [5.0] * contacts,
            )
            so = dimple_readings(found.x, contacts)
            step = 1e-6
            slopes = [
                (
                    dimple_readings(found.x + d, contacts)
                    - dimple_readings(found.x - d, contacts)
                )[0]
                / (2 * step)
                for d in step * np.eye(2 * contacts)
            ]
            one = explanations(
                found.x,
                contacts=contacts,
                so=so,
                jacobian=np.array(slopes)[None],
                weight=weight[k],
                chi2=2 * found.cost,
            )
            wide = 2 * self._most
            rows.append(
                replace(
                    one,
                    parameters=widened(one.parameters, wide),
                    jacobian=widened(one.jacobian, wide),
                    held=widened(one.held, wide),
                    information=widened(one.information, wide, wide),
                )
            )
        whole = rows[0]
        for row in rows[1:]:
            whole = whole.joined(row)
        return whole

    def inside(self, parameters: Any, contacts: int) -> np.ndarray:
        """Angles within the edge, forces up to 60 N."""
        limits = np.repeat([*self.edge, 60.0], contacts)
        return np.clip(parameters, np.repeat([*-self.edge, 0.0], contacts), limits)

    def first_contact(self, places: Any, extents: Any) -> np.ndarray:
        """20 N at the crown."""
        return np.asarray(20.0 * (1 + places[:, 0]))


class DimpleNodes(AbstractNodeSearch):
    """Nodes of the stand-in skin: 0.05 rad apart, forces of 2, 8 and 20 N."""

    def __init__(self) -> None:
        angles, forces = np.linspace(-0.5, 0.5, 21), np.array([2.0, 8.0, 20.0])
        loads = np.stack([np.repeat(angles, 3), np.tile(forces, 21)], 1)
        light = np.stack([angles, np.full(21, 1e-6)], 1)
        signatures = (dimple_readings(light) - AT_REST) / 1e-6
        readings = dimple_readings(loads)
        read = readings, AT_REST, angles[:, None], signatures, np.zeros(13)
        super().__init__(loads, *read, levels=3, separate=0.15)

    def distance(self, a: Any, b: Any) -> np.ndarray:
        """Between angles."""
        return np.asarray(np.abs(a[..., 0] - b[..., 0]))

    def nearest_to(self, parameters: Any, contacts: int) -> np.ndarray:
        """The nearest angle, then the nearest force."""
        place = np.abs(self.places[:, 0] - parameters[:, :1]).argmin(1)
        force = np.abs(self.loads[:3, 1] - parameters[:, contacts : contacts + 1]).argmin(1)
        return np.asarray(3 * place + force)

    def near(self, y: Any, weight: Any, node: Any) -> np.ndarray:
        """The nodes' own loads."""
        return self.loads[node]

    def states(self, node: Any) -> State:
        """No states."""
        return self.rest_states(len(node))

    def rest_states(self, frames: int) -> State:
        """No states."""
        return State(np.zeros((0, 0, frames)), np.zeros(frames), np.ones(frames))  # type: ignore[arg-type]

    def several(self) -> PairSearch:
        """Pairs of all nodes."""
        every = np.arange(len(self.loads))
        return PairSearch(self, every, closest=0.1, apart=0.1)


MU = 3e5
"""Shear modulus of the stand-in rubber [Pa]."""


def neo_hookean(stretch: np.ndarray, mode: str = "uniaxial") -> np.ndarray:
    """Nominal stress of a neo-Hookean solid of 0.3 MPa."""
    power = {"uniaxial": -2.0, "equibiaxial": -5.0, "pure_shear": -3.0}[mode]
    return MU * (stretch - stretch**power)


def tension(stretch: Any, value: Any = None, *, kind: Any = StressTest, **changes: Any) -> Any:
    """A uniaxial test of nominal stresses, by default of a neo-Hookean solid."""
    x = np.asarray(stretch, float)
    n = len(x)
    factors = mode_factors("uniaxial", x)
    factors[2:] /= x
    fields: dict[str, Any] = {
        "mode": "uniaxial",
        "file": "a.csv",
        "value": neo_hookean(x) if value is None else np.asarray(value, float),
        "sigma": np.full(n, np.nan),
        "weight": np.ones(n),
        "specimen": np.full(n, "", object),
        "line": np.arange(n),
        "dropped": {},
        "warnings": (),
        "origin": Origin("strain", "strain", ""),
        "measure": "nominal",
        "coordinate": x,
        "factors": factors,
        "companion": np.zeros(n),
        "direction": np.ones(n, int),
        "time": np.full(n, np.nan),
    }
    return kind(**{**fields, **changes})
