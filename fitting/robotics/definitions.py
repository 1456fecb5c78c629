"""Definitions of the ROS 2 messages that a recording holds, written into the file itself.

Standard messages are those of `common_interfaces` and `tf2_msgs` (Apache 2.0), without their
comments; messages of the package `suas_msgs` say what they mean in theirs.
"""

_TIME = "builtin_interfaces/Time stamp\n"
_HEADER = ("std_msgs/Header", _TIME + "string frame_id\n")
_VECTOR = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n")
_POINT = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n")
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

float64 angle            # [rad] from the skin's symmetry axis
float64 axial            # [m] from the middle of the skin along its axis; NaN in plane strain
float64 force            # [N] inwards; negative where the skin is pulled
float64 diameter         # [m] of the contact; NaN where it was not estimated
float64 direction        # [rad] counter-clockwise from the inward radial; 0 where held radial
float64 tilt             # [rad] of the force towards +axial; 0 where held radial
geometry_msgs/Point position  # [m] on the undeformed outer face, in the skin's frame
string[] names           # what was estimated, in the order of the covariance
float64[] covariance     # of these, by rows, in rad, m and N; empty where none can be stated
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
"""


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
        _CONTACTS, _HEADER, ("suas_msgs/Contact", _CONTACT), _POINT
    ),
}
"""Definitions by the name of the message."""
