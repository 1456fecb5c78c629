"""Array shapes, named once.

Every array of the mechanics ends in a *lane* axis: independent problems side by side,
so that one call advances a whole batch and each operation runs over contiguous memory.
A single problem is one lane. An axis of length one broadcasts against any number of
lanes, so what the lanes share is stored and computed once.

Axis names used in shapes:

- ``station``: nodes along the arc, clamped edge to clamped edge
- ``element``: elements along the arc, one fewer than stations
- ``dof``: unknowns of one station (the block size of the tangent)
- ``component``: Cartesian components x (right) and y (crown up)
- ``gauss``: quadrature points along an element
- ``lane``: independent problems
"""

from typing import TypeAlias

from jaxtyping import Array, Float, Int

Scalar: TypeAlias = Float[Array, ""]
Lanes: TypeAlias = Float[Array, " #lane"]
LaneCounts: TypeAlias = Int[Array, " #lane"]
Diagonal: TypeAlias = Float[Array, "dof dof station #lane"]
OffDiagonal: TypeAlias = Float[Array, "dof dof element #lane"]
StationVector: TypeAlias = Float[Array, "dof station #lane"]
