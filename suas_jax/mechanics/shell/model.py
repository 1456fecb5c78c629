"""The lumped shell as a model that scenes can ask for."""

from collections.abc import Sequence
from typing import ClassVar

from suas_jax.config import SceneSpec
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.model import AbstractArcPlan, AbstractModel, AbstractPlan, Counts
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.mesh.plan import MeshPlan, load_points
from suas_jax.mesh.section import plan_section
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad

_MOST_ELEMENTS = 512
_STRICT = 2e-3  # tolerance that the smallest meshes rarely meet


class ShellPlan(AbstractArcPlan):
    """Elements along the arc."""

    model: ClassVar[str] = "shell"
    arc: MeshPlan  # where they lie

    @property
    def counts(self) -> Counts:
        """Elements along the arc."""
        return (self.arc.elements,)

    @property
    def unknowns_shape(self) -> tuple[int, int]:
        """See the base class."""
        return (4, self.arc.elements + 1)

    def comparisons(self) -> tuple["ShellPlan", ...]:
        """A finer one: solutions cost little."""
        return (ShellPlan(self.arc.refined()),)


class ShellModel(AbstractModel):
    """Elements along the arc, the thickness integrated beforehand."""

    dimension: ClassVar[int] = 2
    name: ClassVar[str] = "shell"
    setting: ClassVar[str] = "elements"

    def first(self, scene: SceneSpec) -> Counts:
        """Enough for every interval between loads, and for most scenes.

        Twice as many cost less than a second program to compile, or to load.
        """
        least = 4 * 2 * (1 + len(scene.loads))
        if scene.rtol <= _STRICT / 10:
            return (max(64, least),)
        return (max(32 if scene.rtol <= _STRICT else 16, least),)

    def first_of_sweep(self, scene: SceneSpec) -> Counts:
        """More than for one solve: points near the wall need them."""
        return (64 if scene.rtol < _STRICT else 32,)

    def finer(self, counts: Counts, excess: tuple[float, ...]) -> Counts | None:
        """Twice as many elements: its programs compile and run in little time."""
        del excess
        return (2 * counts[0],) if 2 * counts[0] <= _MOST_ELEMENTS else None

    def plan(
        self, scene: SceneSpec, counts: Counts, decay: float, slid: Sequence[float] = ()
    ) -> ShellPlan:
        """Stations at clamps and loads, and gathered there; see the base class.

        Under a body the mid-line of a membrane that shears has a kink: elements that bend
        smoothly have none but at a station.
        """
        return ShellPlan(plan_section(scene, counts[0], decay, slid=slid))

    def build(
        self,
        plan: AbstractPlan,
        geometry: SkinGeometry,
        law: AbstractLaw,
        loads: Sequence[LineLoad],
        bodies: Sequence[Body] = (),
    ) -> Shell:
        """The shell on a mesh; see the base class."""
        assert isinstance(plan, ShellPlan)
        touched = [body.angle for body in bodies]
        angles, points = load_points(plan.arc, geometry, loads, touched)
        shell = Shell.build(geometry, law, angles, points, symmetric=plan.symmetric)
        return shell.with_bodies(bodies)


SHELL = ShellModel()
