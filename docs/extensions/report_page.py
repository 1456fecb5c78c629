"""The page of the JSON reports, from the keys that the code declares."""

from collections.abc import Mapping

from fitting.inverse_load.estimate.estimate import STATUS
from fitting.inverse_load.report.frame_keys import CONTACT_KEYS, FIELD_KEYS, FRAME_KEYS
from suas_jax.scene.report_keys import LOAD_KEYS, REPORT_KEYS, REST_KEYS, TAXEL_KEYS

HEAD = """# JSON reports

`suas solve --json` prints one object and nothing else on standard output. Units stand at the
end of the keys; a number that is not known is `null`, never NaN. Whatever goes wrong is an
object with `status` and `message`, too. `suas sweep --json` prints `points`, a list of such
objects, and `first_contact`: `null`, or the `force_N`, `oil_pressure_Pa` and `angle_deg` at
which the membrane reaches the wall.

`suas invert --json` prints one such object a frame. This page is written from the code. Other
reports are described where their commands are:
[`suas fit material`](../material_calibration.md),
[`suas fit sensor`](../sensor_calibration.md).
"""


def page() -> str:
    """The whole page, in MyST Markdown."""
    return "\n".join(
        [
            HEAD,
            _table("suas solve", REPORT_KEYS),
            _table("An entry of `loads`", LOAD_KEYS),
            _table("An entry of `taxels`", TAXEL_KEYS),
            _table("`rest`", REST_KEYS),
            _table("suas invert", FRAME_KEYS),
            _table("A contact", CONTACT_KEYS),
            _table("A load field", FIELD_KEYS),
            _table("Statuses of a frame", STATUS, "status"),
        ]
    )


def _table(title: str, keys: Mapping[str, str], first: str = "key") -> str:
    rows = [f"| `{key}` | {meaning} |" for key, meaning in keys.items()]
    return "\n".join([f"## {title}", "", f"| {first} | meaning |", "|---|---|", *rows, ""])
