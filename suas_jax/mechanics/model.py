"""What a scene asks of a model of the membrane: its meshes, and its mechanics on them.

A model is a folder of `suas_jax.mechanics` that exports one `AbstractModel`. It is found by
its name in `suas_jax.mechanics.registry`; nothing else tells models apart.
"""

import abc
import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import numpy as np

from suas_jax.config import SceneSpec
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mesh.plan import MeshPlan
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import SkinGeometry

Counts = tuple[int, ...]
"""Size of a mesh: numbers of elements, direction by direction, as the model orders them."""


class AbstractPlan(eqx.Module):
    """A mesh as plain numbers, made once for a scene; its shapes decide what is compiled."""

    dimension: ClassVar[int]  # of the model, 2 in plane strain
    # whether a solve takes about as long as optimising its program
    solves_long: ClassVar[bool] = False

    @property
    @abc.abstractmethod
    def model(self) -> str:
        """Name of the model that it is a mesh of."""

    @property
    @abc.abstractmethod
    def counts(self) -> Counts:
        """Numbers of elements."""

    @property
    @abc.abstractmethod
    def unknowns_shape(self) -> tuple[int, int]:
        """Unknowns of a station, and stations, of the mechanics on it."""

    @property
    @abc.abstractmethod
    def symmetric(self) -> bool:
        """Whether it covers a part that stands for the whole by symmetry."""

    @abc.abstractmethod
    def reduced(self) -> Self:
        """The part that has to be solved; the plan itself where loads have no symmetry."""

    @abc.abstractmethod
    def comparisons(self) -> tuple[Self, ...]:
        """The meshes that errors are estimated with, finer or coarser.

        Their differences add up. Where the first one covers the whole membrane, it also tells
        whether a state is stable.
        """

    def meshes(self) -> "Meshes":
        """The meshes that a solve works on, for this one of the whole membrane."""
        return Meshes(self, self.reduced(), self.comparisons(), None)


class AbstractArcPlan(AbstractPlan):
    """A mesh of the section, by its stations along the arc."""

    dimension: ClassVar[int] = 2
    arc: eqx.AbstractVar[MeshPlan]  # where the elements lie along the arc

    @property
    def symmetric(self) -> bool:
        """Whether it covers the left half only."""
        return self.arc.symmetric

    def reduced(self) -> Self:
        """The left half where stations and loads are symmetric."""
        if not self.arc.mirrors_itself:
            return self
        return dataclasses.replace(self, arc=self.arc.half())


class Meshes(NamedTuple):
    """The meshes of one solve."""

    whole: AbstractPlan  # of the whole membrane
    solved: AbstractPlan  # of the part that is solved, or of the whole
    compared: tuple[AbstractPlan, ...]  # with which the error of the mesh is judged
    # of the whole, where its state is assembled to tell whether it is stable and what the
    # mechanics leaves out; None where the mesh for the error is of the whole and answers both
    stability: AbstractPlan | None


class AbstractModel(abc.ABC):
    """A discretised membrane as `[solve] model` names it."""

    dimension: ClassVar[int]  # of the scenes that it solves, 2 in plane strain
    # whether `auto` takes it where another model's error is too large for a curve; one that
    # would take minutes has to be asked for by its name
    for_curves: ClassVar[bool] = True
    name: ClassVar[str]  # in scenes and reports
    setting: ClassVar[str]  # key of [solve] that gives the mesh

    @abc.abstractmethod
    def first(self, scene: SceneSpec) -> Counts:
        """The mesh to try first for a solve."""

    def first_of_sweep(self, scene: SceneSpec) -> Counts:
        """The mesh to try first for a curve, where some load is harder than the others."""
        return self.first(scene)

    @abc.abstractmethod
    def finer(self, counts: Counts, excess: tuple[float, ...]) -> Counts | None:
        """The mesh to try next, or None where the limit is reached.

        `counts`: size of the mesh that was too coarse. `excess`: its estimated error by each
        comparison mesh, over the one that is allowed.
        """

    def coarser(self, counts: Counts) -> Counts:
        """The mesh whose own solution tells the error of another one, under bodies."""
        return tuple(max(2, n // 2) for n in counts)

    @abc.abstractmethod
    def plan(
        self, scene: SceneSpec, counts: Counts, decay: float, slid: Sequence[float] = ()
    ) -> AbstractPlan:
        """Mesh of the whole membrane.

        Args:
            scene: says where loads and clamps are.
            counts: size of the mesh.
            decay: length over which the boundary layers at loads and clamps fade, as an
                angle [rad].
            slid: angle from where each body comes in to the material that it touches [rad];
                none where it is unknown.
        """

    @abc.abstractmethod
    def build(
        self,
        plan: AbstractPlan,  # a mesh of this model
        geometry: SkinGeometry,  # dimensions, with a lane axis
        law: AbstractLaw,  # material, its constants with a lane axis
        loads: Sequence[Any],  # dead forces on the outer face
        bodies: Sequence[Body] = (),  # that are pressed on it
    ) -> AbstractMechanics:
        """The mechanics on a mesh."""

    def carried(
        self, q: np.ndarray, origin: AbstractPlan, target: AbstractPlan
    ) -> np.ndarray | None:
        """A state of one mesh on another one, as a start for Newton's method.

        `q`: its unknowns. `origin`: the mesh that it belongs to. `target`: the other one, of
        the same scene.
        Returns the unknowns there; None where a start gains too little.
        """
        del q, origin, target
        return None

    def given(self, scene: SceneSpec) -> Counts | None:
        """The mesh that the scene insists on, if it is one of this model."""
        mesh = getattr(scene.solve, self.setting)
        return (mesh,) if isinstance(mesh, int) else mesh
