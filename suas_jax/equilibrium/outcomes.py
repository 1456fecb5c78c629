"""Named outcomes of an equilibrium solve, one per lane, with advice."""

import enum


class RESULTS(enum.Enum):
    """How a solve ended. The name is the `status` that the command line prints."""

    converged = ""
    limit_point = (
        "The loads reach a limit point before their full value: beyond it no equilibrium "
        "is connected to the undeformed state and the membrane snaps through. The state "
        "reported is the last equilibrium before it. Reduce the load, or trap the oil."
    )
    no_convergence = (
        "Newton's method found no equilibrium, however small the load step, or friction under "
        "a body did not settle. The state reported is the last equilibrium found. Refine the "
        "mesh, drag a rough body less, or check the material's stability window against the "
        "stretches reached."
    )
    max_steps = (
        "The step budget ran out before the full load, or before the next row of a history. "
        "The state reported is the last one found. Reduce the load, or give a history more "
        "rows: each has a budget of its own."
    )
    unreachable_pressure = (
        "No factor on these loads, starting from zero, brings the oil to the wanted "
        "pressure: it moves the other way, turns back before, or the wall takes the loads "
        "first. The state reported is the last one tried. Check the sign of `oil_pressure` and "
        "of the forces, and its size."
    )
    outside_material_domain = (
        "The state found lies outside the material law's domain, such as beyond a locking "
        "stretch, inside or on a face: the law has no energy there, and no membrane can be in "
        "it. Reduce the load, choose constants whose domain holds the stretches, or, of the "
        "shell, try the solid, which resolves the thickness."
    )
    inverted = (
        "The state found has fibres that are turned inside out: no membrane can be in it. "
        "Reduce the load, refine the mesh, or, of the shell, try the solid."
    )
    unbalanced = (
        "The state found leaves forces that nothing balances: rounding is too large for these "
        "numbers, or Newton's method stood still. Refine the mesh, or change the load a "
        "little."
    )
    volume_not_kept = (
        "The state found does not keep the oil's volume. Refine the mesh, or change the load "
        "a little."
    )
    unstable = (
        "The skin buckles: no membrane stays in the equilibrium found. What it carries at rest "
        "(filling, mounting, warmth, water) buckles it, or its loads do, as one at the crown "
        "of a high arch, which sways. Fill more or less, mount the membrane less long, give "
        "it more thickness, or reduce the load."
    )
    body_on_clamp = (
        "A body reaches a clamped edge, which does not give way: its force has no meaning. "
        "Press it elsewhere, less deep or with less force, or give it a size that stays on the "
        "membrane."
    )
    squeezed = (
        "A body presses the membrane against the wall: between two rigid surfaces the membrane "
        "itself is compressed, which no shell knows, and its force has no meaning. Press the "
        'body less deep, or set solve.model = "solid", which resolves the membrane. A travel '
        "that ends inside the wall has no solution in any model."
    )
    sharp_body = (
        "A body's tip is sharper than the mesh resolves: its points catch on the tip, over "
        "which the skin slides freely. Give it a larger radius, or more `solve.elements`."
    )
    sliding = (
        "A body is pulled along with more than friction holds: it slides, and no drag carries "
        "the force. The state reported is the nearest to it. Pull less, press harder, or give "
        "the drag instead of the force."
    )
    beyond_model = (
        "What the thin shell leaves out changes the state found by more than its first-order "
        "effect can tell, or brings the face through the wall: readings of it mean nothing. "
        "Reduce the load, or ask `suas solve` with the solid for this one."
    )


# What is stored per lane is a position in this list.
NAMES = tuple(RESULTS.__members__)

# Of a state that no membrane can be in, or that the model does not tell: its numbers mean
# nothing, where those of other failures hold for less than the full load.
MEANINGLESS = (
    "outside_material_domain",
    "inverted",
    "unbalanced",
    "volume_not_kept",
    "body_on_clamp",
    "squeezed",
    "sharp_body",
    "beyond_model",
)

# Of a path that does not go on, which may have lost its stability long before.
PATH_ENDS = ("limit_point", "no_convergence")


def index_of(name: str) -> int:
    """Position of a result's name, as stored per lane."""
    return NAMES.index(name)


def advice(name: str) -> str:
    """What a result means and what to do; empty for `converged`."""
    return RESULTS[name].value
