"""Taxels and contacts as ROS 2 messages: dictionaries that the recording encodes.

The skin's frame has its origin in the middle of the axis of the half-cylinder: x towards
growing angles, y to the crown, z along the axis. A contact's frame lies on the undeformed
outer face: x towards growing angles, y along the axis, z inwards.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fitting.inverse_load.estimate.estimate import STATUS, Contact, LoadEstimate
from suas_jax.scene.taxel_film import TaxelFilm

WORLD_FRAME, SKIN_FRAME = "world", "suas_skin"
_NUMBERS = ("x", "y", "z", "gap", "counts", "above_rest")
_POINT = np.dtype([*((name, "<f4") for name in _NUMBERS), ("valid", "u1")])
_FLOAT32, _UINT8 = 7, 2  # of sensor_msgs/PointField
_FIELDS = [
    {"name": name, "offset": 4 * k, "datatype": _FLOAT32, "count": 1}
    for k, name in enumerate(_NUMBERS)
] + [{"name": "valid", "offset": 4 * len(_NUMBERS), "datatype": _UINT8, "count": 1}]


def contact_frame(k: int) -> str:
    """Frame of the contact with a number from 0, by angle."""
    return f"suas_contact_{k}"


def header(stamp: int, frame: str) -> dict[str, Any]:
    """A header.

    Args:
        stamp: nanoseconds since 1970.
        frame: that the message's numbers are in.
    """
    seconds, rest = divmod(stamp, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def point_cloud(
    stamp: int, film: TaxelFilm, so: NDArray, gap: NDArray, valid: NDArray
) -> dict[str, Any]:
    """The taxels as points on the wall, with gap, counts and counts above rest.

    Args:
        stamp: nanoseconds since 1970.
        film: of the skin.
        so: readings [taxel] [counts]; NaN where missing.
        gap: that they mean [taxel] [m].
        valid: whether a reading can be used [taxel].
    """
    points = np.empty(len(so), _POINT)
    points["x"], points["y"], points["z"] = film.positions.T
    points["gap"], points["counts"], points["above_rest"] = gap, so, so - film.rest
    points["valid"] = valid
    return {
        "header": header(stamp, SKIN_FRAME),
        "height": 1,
        "width": len(so),
        "fields": _FIELDS,
        "is_bigendian": False,
        "point_step": _POINT.itemsize,
        "row_step": points.nbytes,
        "data": points.tobytes(),
        "is_dense": bool(np.isfinite(so).all()),
    }


def position(contact: Contact, outer_radius: float) -> tuple[float, float, float]:
    """Where a contact is on the undeformed outer face, in the skin's frame [m]."""
    x, y = outer_radius * np.sin(contact.angle), outer_radius * np.cos(contact.angle)
    return float(x), float(y), contact.axial or 0.0


def transform(
    stamp: int,
    child: str,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
    angle: float | None = None,
) -> dict[str, Any]:
    """The transform of a contact's frame, or without an angle of the skin's in the world.

    Args:
        stamp: nanoseconds since 1970.
        child: the frame.
        place: of its origin [m].
        angle: of a contact, from the skin's symmetry axis [rad].
    """
    turn, parent = Rotation.identity(), WORLD_FRAME
    if angle is not None:
        c, s = np.cos(angle), np.sin(angle)
        turn, parent = Rotation.from_matrix([[c, 0, -s], [-s, 0, -c], [0, 1, 0]]), SKIN_FRAME
    return {
        "header": header(stamp, parent),
        "child_frame_id": child,
        "transform": {
            "translation": _named(place, "xyz"),
            "rotation": _named(turn.as_quat().tolist(), "xyzw"),
        },
    }


def wrench(stamp: int, k: int, contact: Contact | None) -> dict[str, Any]:
    """The force of a contact on the skin, in the contact's frame; zero where there is none."""
    force = 0.0 if contact is None else contact.force
    turn = 0.0 if contact is None else contact.direction or 0.0
    tilt = 0.0 if contact is None else contact.tilt or 0.0
    plane = force * np.cos(tilt)
    along = (plane * np.sin(turn), force * np.sin(tilt), plane * np.cos(turn))
    return {
        "header": header(stamp, contact_frame(k)),
        "wrench": {"force": _named(along, "xyz"), "torque": _named((0.0, 0.0, 0.0), "xyz")},
    }


def contacts(
    stamp: int, sequence: int, estimate: LoadEstimate, outer_radius: float
) -> dict[str, Any]:
    """An estimate with its status and covariances."""
    return {
        "header": header(stamp, SKIN_FRAME),
        "sequence": sequence % 2**32,
        "status": estimate.status,
        "message": STATUS.get(estimate.status, ""),
        "contact": _answer(estimate.contact),
        "wall_contact": _answer(estimate.wall_contact),
        "oil_pressure": estimate.oil_pressure,
        "chi2_per_dof": estimate.chi2_per_dof,
        "latency": estimate.latency,
        "left_out": list(estimate.left_out),
        "contacts": [_contact(contact, outer_radius) for contact in estimate.contacts],
    }


def _contact(contact: Contact, outer_radius: float) -> dict[str, Any]:
    nan = float("nan")
    covariance = contact.covariance
    return {
        "angle": contact.angle,
        "axial": nan if contact.axial is None else contact.axial,
        "force": contact.force,
        "diameter": nan if contact.diameter is None else contact.diameter,
        "direction": contact.direction or 0.0,
        "tilt": contact.tilt or 0.0,
        "position": _named(position(contact, outer_radius), "xyz"),
        "names": list(contact.names),
        "covariance": [] if covariance is None else covariance.reshape(-1).tolist(),
    }


def _answer(known: bool | None) -> int:
    """NO, YES or UNKNOWN of the definition."""
    return 2 if known is None else int(known)


def _named(values: Any, names: str) -> dict[str, float]:
    return dict(zip(names, map(float, values), strict=True))
