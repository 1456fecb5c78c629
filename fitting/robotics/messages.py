"""Taxels and contacts as ROS 2 messages: dictionaries that the recording encodes.

The skin's frame has its origin at mid-width, where x and y of the section are zero (of a
circle the axis): x towards growing angles, y to the crown, z along the axis. A contact's
frame lies on the undeformed outer face: x towards growing angles, y along the axis, z inwards.

Standard messages are those of `common_interfaces` and `tf2_msgs` (Apache 2.0), without their
comments; messages of the package `suas_msgs` say what they mean in theirs.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from fitting.inverse_load.estimate.estimate import STATUS, Contact, LoadEstimate
from fitting.inverse_load.estimate.load_field import FIELD_QUANTITIES, LoadField
from suas_jax.config import GeometrySpec
from suas_jax.scene.taxel_film import TaxelFilm
from suas_jax.skin.plain import plain_geometry

_POINTS = 4001  # of the outer face: places between them are good to 1e-12 m

_TIME = "builtin_interfaces/Time stamp\n"
_HEADER = ("std_msgs/Header", _TIME + "string frame_id\n")
_VECTOR = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n")
_POINT_FIELDS = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n")
_QUATERNION = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n")
_TRANSFORM = (
    "geometry_msgs/Transform",
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
)
_STAMPED = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
)
_WRENCH = (
    "geometry_msgs/Wrench",
    "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
)
_FIELD = (
    "sensor_msgs/PointField",
    "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\n"
    "uint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\n"
    "string name\nuint32 offset\nuint8 datatype\nuint32 count\n",
)
_CLOUD = """std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
"""
_TAXELS = """# One frame of the taxels of a soft underwater artificial skin.
# All arrays have one entry a taxel, in the order of the skin file's layout.

std_msgs/Header header   # stamp: when the host read the frame; frame_id: the skin's frame
uint32 sequence          # number of the frame, as the device counts
float64 device_time      # [s] on the device's clock, or the host's where it has none
uint16 FULL_SCALE=65535  # [counts] at which the converter saturates

uint16[] module          # number of the module that carries the taxel
uint16[] number          # of the taxel in its module, from 1
float64[] counts         # [counts] raw sensor output; NaN where missing
float64[] rest           # [counts] sensor output at rest
float64[] gap            # [m] film of oil between wall and membrane that the counts mean
bool[] valid             # counts are there, not saturated, and the taxel is not stuck
"""
_CONTACT = """# A contact, where it is on the skin and how sure that is.

float64 angle            # [rad] as scenes state it: on a circle from the symmetry axis
float64 arc              # [m] of the inner face from its middle; NaN on a circle
float64 axial            # [m] from the middle of the skin along its axis; NaN in plane strain
float64 force            # [N] inwards; negative where the skin is pulled
float64 diameter         # [m] of the contact; NaN where it was not estimated
float64 direction        # [rad] counter-clockwise from the inward radial; 0 where held radial
float64 tilt             # [rad] of the force towards +axial; 0 where held radial
geometry_msgs/Point position  # [m] on the undeformed outer face, in the skin's frame
string[] names           # what was estimated, in the order of the covariance
float64[] covariance     # of these, by rows, in rad, m and N; empty where none can be stated
"""
_LOAD_FIELD = """# A pressure over the skin: values, and the ends of intervals that hold them in
# 95 of 100 cases.

float64[] force          # [N] total along the inward normals
float64[] right          # [N] sum of the forces as vectors, along x of the skin's frame
float64[] up             # [N] the same along y
float64[] angle          # [rad] of their centre, as scenes state it
float64[] arc            # [m] the same of the inner face from its middle; empty on a circle
float64[] axial          # [m] the same along the axis; empty in plane strain
float64[] arc_extent     # [m] diameter along the arc of the even ellipse of the forces
float64[] axial_extent   # [m] the same along the axis; empty in plane strain
float64 preferred_by     # how much less -2 log(evidence) is than that of contacts
"""
_CONTACTS = """# What was estimated from one frame.

std_msgs/Header header
uint32 sequence          # number of the frame
string status            # outcome in a word, such as ok, no_contact, imprecise
string message           # what it means
int8 NO=0
int8 YES=1
int8 UNKNOWN=2
int8 contact             # whether anything touches the skin
int8 wall_contact        # whether the membrane lies on the wall
float64 oil_pressure     # [Pa] above ambient; NaN where unknown
float64 chi2_per_dof     # weighted squares of the residuals per degree of freedom
float64 latency          # [s] see `suas invert`
uint32[] left_out        # taxels that were not used, by position in the layout
suas_msgs/Contact[] contacts
suas_msgs/LoadField[] field  # one where a pressure over the skin is told, else none
"""

WORLD_FRAME, SKIN_FRAME = "world", "suas_skin"
_NUMBERS = ("x", "y", "z", "gap", "counts", "above_rest")
_POINT = np.dtype([*((name, "<f4") for name in _NUMBERS), ("valid", "u1")])
_FLOAT32, _UINT8 = 7, 2  # of sensor_msgs/PointField
_FIELDS = [
    {"name": name, "offset": 4 * k, "datatype": _FLOAT32, "count": 1}
    for k, name in enumerate(_NUMBERS)
] + [{"name": "valid", "offset": 4 * len(_NUMBERS), "datatype": _UINT8, "count": 1}]


def _joined(text: str, *parts: tuple[str, str]) -> str:
    """A definition with those that it uses, as MCAP asks for them."""
    line = "=" * 80
    return text + "".join(f"{line}\nMSG: {name}\n{part}" for name, part in parts)


DEFINITIONS = {
    "sensor_msgs/msg/PointCloud2": _joined(_CLOUD, _HEADER, _FIELD),
    "geometry_msgs/msg/WrenchStamped": _joined(
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n", _HEADER, _WRENCH, _VECTOR
    ),
    "tf2_msgs/msg/TFMessage": _joined(
        "geometry_msgs/TransformStamped[] transforms\n",
        _STAMPED,
        _HEADER,
        _TRANSFORM,
        _VECTOR,
        _QUATERNION,
    ),
    "suas_msgs/msg/Taxels": _joined(_TAXELS, _HEADER),
    "suas_msgs/msg/Contacts": _joined(
        _CONTACTS,
        _HEADER,
        ("suas_msgs/Contact", _CONTACT),
        _POINT_FIELDS,
        ("suas_msgs/LoadField", _LOAD_FIELD),
    ),
}
"""Definitions by the name of the message."""


def contact_frame(k: int) -> str:
    """Frame of the contact with a number from 0, by angle."""
    return f"suas_contact_{k}"


def header(stamp: int, frame: str) -> dict[str, Any]:
    """A header. `stamp`: nanoseconds since 1970. `frame`: that the message's numbers are in."""
    seconds, rest = divmod(stamp, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def point_cloud(
    stamp: int, film: TaxelFilm, so: NDArray, gap: NDArray, valid: NDArray
) -> dict[str, Any]:
    """The taxels as points on the wall, with gap, counts and counts above rest.

    `stamp`: nanoseconds since 1970. `so`: readings [taxel] [counts]; NaN where missing. `gap`:
    that they mean [taxel] [m]. `valid`: whether a reading can be used [taxel].
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


class Place(NamedTuple):
    """A place on the undeformed outer face, in the skin's frame."""

    position: tuple[float, float, float]  # [m]
    direction: float  # of the outward normal from the y axis, towards +x [rad]


class OuterFace:
    """The undeformed outer face of a skin, along whose arc contacts lie."""

    def __init__(self, spec: GeometrySpec) -> None:
        section = plain_geometry(spec).section
        half = float(section.half_angle[0])
        angle = np.linspace(-half, half, _POINTS)[:, None]
        at = jnp.asarray(angle)
        outer = section.inner_face(at) + section.thickness(at) * section.inner_normal(at)
        rows = [*np.asarray(outer)[..., 0], np.asarray(section.direction(at))[:, 0]]
        along = section.given_angle(at) if spec.has_angle else section.arc(at)
        self._table = CubicSpline(np.asarray(along)[:, 0], np.stack(rows, 1))

    def at(self, contact: Contact) -> Place:
        """Where a contact is."""
        x, y, direction = self._table(contact.arc if contact.by_arc else contact.angle)
        return Place((float(x), float(y), contact.axial or 0.0), float(direction))


def transform(
    stamp: int,  # nanoseconds since 1970
    child: str,  # the frame
    place: Place | None = None,  # of the contact
) -> dict[str, Any]:
    """The transform of a contact's frame, or without a place of the skin's in the world."""
    turn, parent, origin = Rotation.identity(), WORLD_FRAME, (0.0, 0.0, 0.0)
    if place is not None:
        c, s = np.cos(place.direction), np.sin(place.direction)
        turn, parent = Rotation.from_matrix([[c, 0, -s], [-s, 0, -c], [0, 1, 0]]), SKIN_FRAME
        origin = place.position
    return {
        "header": header(stamp, parent),
        "child_frame_id": child,
        "transform": {
            "translation": _named(origin, "xyz"),
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
    stamp: int, sequence: int, estimate: LoadEstimate, face: OuterFace
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
        "contacts": [_contact(contact, face) for contact in estimate.contacts],
        "field": [] if estimate.field is None else [_field(estimate.field)],
    }


def _field(field: LoadField) -> dict[str, Any]:
    known = {name: list(getattr(field, name) or ()) for name in FIELD_QUANTITIES}
    return {**known, "preferred_by": field.preferred_by}


def _contact(contact: Contact, face: OuterFace) -> dict[str, Any]:
    nan = float("nan")
    covariance = contact.covariance
    return {
        "angle": contact.angle,
        "arc": nan if contact.arc is None else contact.arc,
        "axial": nan if contact.axial is None else contact.axial,
        "force": contact.force,
        "diameter": nan if contact.diameter is None else contact.diameter,
        "direction": contact.direction or 0.0,
        "tilt": contact.tilt or 0.0,
        "position": _named(face.at(contact).position, "xyz"),
        "names": list(contact.names),
        "covariance": [] if covariance is None else covariance.reshape(-1).tolist(),
    }


def _answer(known: bool | None) -> int:
    """NO, YES or UNKNOWN of the definition."""
    return 2 if known is None else int(known)


def _named(values: Any, names: str) -> dict[str, float]:
    return dict(zip(names, map(float, values), strict=True))
