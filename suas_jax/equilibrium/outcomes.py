"""Named outcomes of an equilibrium solve, one per lane, with advice."""

import equinox as eqx


class RESULTS(eqx.Enumeration):
    """How a solve ended. The name is the `status` that the command line prints."""

    converged = ""
    limit_point = (
        "The loads reach a limit point before their full value: beyond it no equilibrium "
        "is connected to the undeformed state and the membrane snaps through. The state "
        "reported is the last equilibrium before it. Reduce the load, or trap the oil."
    )
    no_convergence = (
        "Newton's method found no equilibrium, however small the load step. The state "
        "reported is the last equilibrium found. Refine the mesh, or check the material's "
        "stability window against the stretches reached."
    )
    max_steps = (
        "The step budget ran out before the full load. The state reported is the last "
        "equilibrium found. Reduce the load or raise `max_steps`."
    )
    unreachable_pressure = (
        "No factor on these loads, starting from zero, brings the oil to the wanted "
        "pressure: it moves the other way or turns back before. Check the sign of "
        "`oil_pressure` and of the forces."
    )


# In the order of the enumeration: what is stored per lane is a position in this list.
NAMES: tuple[str, ...] = (
    "converged",
    "limit_point",
    "no_convergence",
    "max_steps",
    "unreachable_pressure",
)


def index_of(name: str) -> int:
    """Position of a result's name, as stored per lane."""
    return NAMES.index(name)


def advice(name: str) -> str:
    """What a result means and what to do; empty for `converged`."""
    return str(RESULTS[getattr(RESULTS, name)])  # type: ignore[misc]
