"""An MCAP file of taxels, contacts and transforms, with units, frames and thresholds.

The libraries come with ``pip install "suas-jax[robotics]"``; ROS isn't needed.
"""

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Self

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.estimate.estimate import WANTED, LoadEstimate
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.live.stream import FrameReadings, LiveFrame, LiveWatcher
from fitting.inverse_load.readings import LogReadings
from fitting.robotics import messages
from fitting.robotics.messages import DEFINITIONS
from suas_jax.acquisition.log.data import MAX_COUNT
from suas_jax.config import SkinSpec
from suas_jax.files.reading import read_bytes
from suas_jax.files.writing import written
from suas_jax.runtime.optional import optional
from suas_jax.scene.taxel_film import TaxelFilm

_CONVENTIONS = {
    "units": "SI: m, rad, N, Pa, s; sensor outputs in counts",
    "frames": f"{messages.SKIN_FRAME}: origin at mid-width, where x and y of the section are "
    "zero, x towards growing angles, y to the crown, z along the axis; suas_contact_k: on the "
    "undeformed outer face, x towards growing angles, y along the axis, z inwards",
    "gap": "of the even film of oil that gives a taxel's counts, between wall and membrane",
    "wrench": "force of the contact on the skin, in the contact's frame; zero once it has gone",
    "stamps": "when the host read the frame",
    "saturation_counts": str(MAX_COUNT),
}
_MOST_SKIN = 3_000_000  # bytes of a skin file, as they are read

_EVERY = 100  # frames between two reports of progress


class Recording:
    """An MCAP file that is being written, and lies at its place once it is closed.

    `rest`: readings at rest [taxel] [counts]; those of the model where not given. `estimator`:
    whose thresholds are written; None where nothing is estimated.
    Raises ValueError: the libraries are not installed; OSError: the file can't be written.
    """

    def __init__(
        self,
        path: Path,  # of the file
        spec: SkinSpec,  # the skin
        *,
        rest: Floats | None = None,
        estimator: LoadEstimator | None = None,
        skin_file: Path | None = None,  # attached, where it is a TOML file
    ) -> None:
        require_mcap()
        from mcap_ros2.writer import Writer

        self._film = TaxelFilm(spec, rest)
        self._face = messages.OuterFace(spec.geometry)
        self._shown = 0  # contacts that have a wrench
        with contextlib.ExitStack() as stack:
            draft = stack.enter_context(written(path))
            stream = stack.enter_context(draft.open("wb"))
            self._writer = stack.enter_context(Writer(stream))
            self._close = stack.pop_all()
        self._schemas = {
            name: self._writer.register_msgdef(name, text) for name, text in DEFINITIONS.items()
        }
        facts = _CONVENTIONS | _thresholds(estimator)
        self._writer.add_metadata("suas", facts)
        if skin_file is not None and skin_file.suffix.lower() == ".toml":
            content = read_bytes(skin_file, _MOST_SKIN)
            self._writer.add_attachment(0, 0, skin_file.name, "application/toml", content)
        self._begun = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: Any) -> None:
        self._close.__exit__(*raised)

    def taxels(
        self, stamp: int, sequence: int, device_time: float, so: Floats, stuck: Flags
    ) -> None:
        """Write a frame's readings.

        `stamp`: when the host read it, nanoseconds since 1970. `device_time`: on the device's
        clock [s]. `so`: readings [taxel] [counts]; NaN where missing. `stuck`: taxels that
        repeat one count beyond chance [taxel].
        """
        if not self._begun:
            self._begun = True
            fixed = messages.transform(stamp, messages.SKIN_FRAME)
            self._write("/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": [fixed]}, stamp)
        film, gap = self._film, self._film.gap(so)
        valid = np.isfinite(so) & (so > 0) & (so < MAX_COUNT) & ~stuck
        cloud = messages.point_cloud(stamp, film, so, gap, valid)
        self._write("/suas/points", "sensor_msgs/msg/PointCloud2", cloud, stamp, sequence)
        frame = {
            "header": messages.header(stamp, messages.SKIN_FRAME),
            "sequence": sequence % 2**32,
            "device_time": device_time,
            "module": film.module,
            "number": film.number,
            "counts": so.tolist(),
            "rest": film.rest.tolist(),
            "gap": gap.tolist(),
            "valid": valid.tolist(),
        }
        self._write("/suas/taxels", "suas_msgs/msg/Taxels", frame, stamp, sequence)

    def contacts(self, stamp: int, sequence: int, estimate: LoadEstimate) -> None:
        """Write what was estimated from a frame.

        `stamp`: when the host read the frame, nanoseconds since 1970. `estimate`: its contacts,
        with covariances.
        """
        told = messages.contacts(stamp, sequence, estimate, self._face)
        self._write("/suas/contacts", "suas_msgs/msg/Contacts", told, stamp, sequence)
        found = estimate.contacts
        moved = [
            messages.transform(stamp, messages.contact_frame(k), self._face.at(contact))
            for k, contact in enumerate(found)
        ]
        if moved:
            self._write("/tf", "tf2_msgs/msg/TFMessage", {"transforms": moved}, stamp)
        for k in range(max(len(found), self._shown)):
            force = messages.wrench(stamp, k, found[k] if k < len(found) else None)
            topic = f"/suas/contact_{k}/wrench"
            self._write(topic, "geometry_msgs/msg/WrenchStamped", force, stamp, sequence)
        self._shown = len(found)

    def _write(
        self, topic: str, name: str, message: dict[str, Any], stamp: int, sequence: int = 0
    ) -> None:
        schema = self._schemas[name]
        self._writer.write_message(topic, schema, message, stamp, sequence=sequence % 2**32)


def require_mcap() -> None:
    """Make sure that the libraries are there. Raises ValueError: one is missing."""
    optional("mcap_ros2", "MCAP files need", "robotics")


def start_stamp(header: Mapping[str, str]) -> int:
    """Nanoseconds from 1970 to a log's start; 0 where its header does not state it."""
    try:
        start = datetime.fromisoformat(header["start_time"])
    except (KeyError, ValueError):
        return 0
    return round(start.timestamp() * 1e6) * 1000 if start.tzinfo is not None else 0


def _thresholds(estimator: LoadEstimator | None) -> dict[str, str]:
    """What decides statuses, in words and SI units."""
    if estimator is None:
        return {}
    return {
        "noise_counts": f"{estimator.reading_noise:g}",
        "false_alarm_rate": f"{estimator.false_alarm:g}",
        "model_error": f"{estimator.model_error:g}",
        "most_contacts": str(estimator.most_contacts),
    } | {
        f"imprecise_above_{name}": f"{limit:.6g}"
        + {"force": " of the force", "axial": " m"}.get(name, " rad")
        for name, limit in WANTED.items()
    }


class LiveRecording(LiveWatcher):
    """Writes every frame's readings, and the loads of those that were not dropped."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        # Frames are stamped by the clock that never steps, recordings by the calendar.
        self._epoch = time.time_ns() - round(1e9 * time.monotonic())

    def read(self, frame: FrameReadings) -> None:
        """Write its readings."""
        self._recording.taxels(self._stamp(frame), frame.seq, frame.time, frame.so, frame.stuck)

    def estimated(self, frame: LiveFrame) -> None:
        """Write its loads."""
        if frame.readings is not None:
            stamp = self._stamp(frame.readings)
            self._recording.contacts(stamp, frame.seq, frame.estimate)

    def _stamp(self, frame: FrameReadings) -> int:
        return self._epoch + round(1e9 * frame.arrived)


def write_readings(
    recording: Recording,
    readings: LogReadings,  # of the log
    estimates: Sequence[LoadEstimate] | None,  # of its frames; None where nothing was estimated
    done: Callable[[int], None] = lambda frames: None,
) -> None:
    """Write a log's frames. `done`: called with the number of frames written so far."""
    stamps = start_stamp(readings.header) + np.round(1e9 * readings.host_time).astype(np.int64)
    for i, stamp in enumerate(np.maximum(stamps, 0).tolist()):
        sequence = int(readings.seq[i])
        recording.taxels(
            stamp, sequence, float(readings.time[i]), readings.so[i], readings.stuck[i]
        )
        if estimates is not None:
            recording.contacts(stamp, sequence, estimates[i])
        if i % _EVERY == 0:
            done(i)
