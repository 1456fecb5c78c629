"""MCAP recordings read back: what a tool of robotics finds in them."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation
from skins import shaped
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate, Tap
from fitting.inverse_load.estimate.load_field import Interval, LoadField
from fitting.inverse_load.report.read_back import read_estimates
from fitting.inverse_load.report.text import frame_json
from fitting.json_text import json_text
from fitting.robotics import messages
from suas_jax.acquisition.log.log_file import LogWriter, log_header
from suas_jax.config import load_skin

SKIN = Path(__file__).parent.parent / "configs" / "skins" / "suas.toml"
FRAMES = 5
REST = 5e-3  # the skin's oil gap [m]
EPSILON, LSB, AREA = 8.8541878188e-12 * 2.2, 0.305e-15, np.pi / 4 * 4e-3**2

Messages = dict[str, list[tuple[int, Any]]]


def counts_under(gap: float) -> int:
    return round(EPSILON * AREA / gap / LSB)


COVARIANCE = np.array([[1e-4, 2e-5, 0.0], [2e-5, 0.04, 0.0], [0.0, 0.0, 1e-3]])
WIDE = Interval(0.5, 0.25, 0.75)
ESTIMATES = [
    LoadEstimate(False, status="no_contact", oil_pressure=0.0, wall_contact=False),
    LoadEstimate(
        True,
        (
            Contact(np.deg2rad(-40), 3.0, None, None),
            Contact(np.deg2rad(30), 7.0, np.deg2rad(20), COVARIANCE),
        ),
        oil_pressure=1234.5,
        wall_contact=False,
        chi2_per_dof=1.1,
        status="ok",
        left_out=(3,),
    ),
    LoadEstimate(True, (Contact(0.2, 40.0, None, None),), status="wall_contact", at_least=38.0),
    LoadEstimate(None, status="too_few_taxels"),
    LoadEstimate(
        True,
        (Contact(-0.1, -2.0, None, None),),
        10.0,
        False,
        1.0,
        "pull",
        alternatives=(Contact(0.3, 5.0, None, COVARIANCE[:2, :2]),),
        drift=(1.0, -4.0),
        tap=Tap(6.5, 0.2, Contact(0.125, float("nan"), None, None), 0.03, 0.01),
        field=LoadField(*[Interval(20.0, 15.0, 40.0)] * 3, *[WIDE] * 2, 12.0),
    ),
]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log in which taxel 3 is under 3 mm of oil, 5 is missing, 7 saturated."""
    path = tmp_path_factory.mktemp("recording") / "press.csv"
    rest = counts_under(REST)
    with LogWriter(path, log_header(skin=str(SKIN))) as writer:
        for k in range(FRAMES):
            row = [rest, rest, counts_under(3e-3), rest, None, rest, 65535, rest]
            writer.write(0.01 * k, 7.0 + 0.01 * k, 100 + k, 0, row, ())
    return path


@pytest.fixture(scope="module")
def loads(log: Path) -> Path:
    path = log.with_suffix(".jsonl")
    lines = [frame_json(0.0, 100 + k, e) for k, e in enumerate(ESTIMATES)]
    path.write_text("\n".join(map(json_text, lines)) + "\n")
    return path


def recorded(path: Path) -> tuple[Messages, dict[str, str], dict[str, bytes]]:
    """Messages by topic with their stamps, the facts, and the attachments."""
    found: Messages = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
        (facts,) = (entry.metadata for entry in reader.iter_metadata())
        attached = {entry.name: entry.data for entry in reader.iter_attachments()}
    return found, facts, attached


def export(*arguments: Any, status: int = 0) -> str:
    result = CliRunner().invoke(app, ["export", "mcap", *map(str, arguments)])
    assert result.exit_code == status, result.output
    return result.stderr


@pytest.fixture(scope="module")
def recording(log: Path, loads: Path) -> tuple[Messages, dict[str, str], dict[str, bytes]]:
    export(log, "--loads", loads)
    return recorded(log.with_suffix(".mcap"))


def test_taxels_have_their_place_and_their_gap(recording: Any) -> None:
    messages, facts, attached = recording
    assert attached == {"suas.toml": SKIN.read_bytes()}
    assert facts["saturation_counts"] == "65535"
    assert "crown" in facts["frames"]
    clouds = messages["/suas/points"]
    assert len(clouds) == FRAMES
    assert [stamp - clouds[0][0] for stamp, _ in clouds] == [10_000_000 * k for k in range(5)]
    cloud = clouds[0][1]
    assert cloud.header.frame_id == "suas_skin"
    assert cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec == clouds[0][0]
    names = [field.name for field in cloud.fields]
    assert names == ["x", "y", "z", "gap", "counts", "above_rest", "valid"]
    assert (cloud.width, cloud.row_step, len(cloud.data)) == (8, 8 * 25, 8 * 25)
    points = np.array([struct.unpack_from("<6fB", cloud.data, 25 * k) for k in range(8)])
    angle = np.deg2rad([-70, -50, -30, -10, 10, 30, 50, 70])
    place = 0.0525 * np.stack([np.sin(angle), np.cos(angle), 0 * angle], 1)
    np.testing.assert_allclose(points[:, :3], place, atol=1e-8)
    # Whole counts, of which there are some 160 at rest.
    gap = [REST, REST, 3e-3, REST, np.nan, REST, np.nan, REST]
    np.testing.assert_allclose(points[[0, 1, 2, 3, 4, 5, 7], 3], np.delete(gap, 6), rtol=4e-3)
    assert points[2, 5] == pytest.approx(counts_under(3e-3) - counts_under(REST), abs=1)
    np.testing.assert_array_equal(points[:, 6], [1, 1, 1, 1, 0, 1, 0, 1])


def test_the_taxels_own_message_says_what_it_holds(recording: Any) -> None:
    messages, _, _ = recording
    _, frame = messages["/suas/taxels"][2]
    assert (frame.sequence, frame.device_time) == (102, 7.02)
    assert list(frame.module) == [0] * 8
    assert list(frame.number) == list(range(1, 9))
    assert frame.counts[2] == counts_under(3e-3)
    assert np.isnan(frame.counts[4])
    assert list(frame.valid) == [True] * 4 + [False, True, False, True]


def test_contacts_come_with_frame_force_and_covariance(recording: Any) -> None:
    messages, _, _ = recording
    statuses = [told.status for _, told in messages["/suas/contacts"]]
    assert statuses == [e.status for e in ESTIMATES]
    told = messages["/suas/contacts"][1][1]
    assert (told.contact, told.wall_contact, told.oil_pressure) == (1, 0, 1234.5)
    assert list(told.left_out) == [3]
    assert [list(c.covariance) for c in told.contacts] == [[], COVARIANCE.ravel().tolist()]
    assert list(told.contacts[1].names) == ["angle", "force", "direction"]
    transforms = {t.child_frame_id: t for t in messages["/tf"][0][1].transforms}
    moved = transforms["suas_contact_1"].transform
    place = [getattr(moved.translation, k) for k in "xyz"]
    normal = np.array([np.sin(np.pi / 6), np.cos(np.pi / 6), 0.0])
    np.testing.assert_allclose(place, 0.059 * normal, atol=1e-12)
    turn = Rotation.from_quat([getattr(moved.rotation, k) for k in "xyzw"])
    np.testing.assert_allclose(turn.apply([0, 0, 1]), -normal, atol=1e-12)
    np.testing.assert_allclose(turn.apply([0, 1, 0]), [0, 0, 1], atol=1e-12)
    # A force turned counter-clockwise by 20 degrees from the inward radial.
    pushed = messages["/suas/contact_1/wrench"][0][1].wrench.force
    force = turn.apply([pushed.x, pushed.y, pushed.z])
    inward = np.pi + np.pi / 2 - np.pi / 6 + np.deg2rad(20)
    np.testing.assert_allclose(force, 7 * np.array([np.cos(inward), np.sin(inward), 0]))
    (fixed,) = messages["/tf_static"][0][1].transforms
    assert (fixed.header.frame_id, fixed.child_frame_id) == ("world", "suas_skin")


def test_a_contact_that_has_gone_pushes_no_more(recording: Any) -> None:
    messages, _, _ = recording
    forces = [told.wrench.force.z for _, told in messages["/suas/contact_0/wrench"]]
    assert forces == [3.0, 40.0, 0.0, -2.0]
    assert [told.wrench.force.z for _, told in messages["/suas/contact_1/wrench"]][1:] == [0.0]


def test_a_load_field_is_recorded_with_its_intervals(recording: Any) -> None:
    told = [message for _, message in recording[0]["/suas/contacts"]]
    (field,) = told[-1].field
    assert list(field.force) == [20.0, 15.0, 40.0]
    assert list(field.arc_extent) == [0.5, 0.25, 0.75]
    assert not list(field.axial)
    assert not told[0].field


def test_estimates_are_read_back_as_they_were_printed(log: Path, loads: Path) -> None:
    again = read_estimates(loads, np.arange(100, 105))
    lines = [json_text(frame_json(0.0, 100 + k, e)) for k, e in enumerate(again)]
    assert [json.loads(x) for x in lines] == [
        json.loads(x) for x in loads.read_text().splitlines()
    ]


def test_what_cannot_be_exported_is_refused(log: Path, loads: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.mcap"
    bad = tmp_path / "bad.jsonl"
    bad.write_text(loads.read_text().replace('"status": "pull"', '"status": "fine"'))
    assert "line 5" in export(log, "-o", target, "--loads", bad, status=2)
    bad.write_text("\n".join(loads.read_text().splitlines()[1:]))
    assert "4 frames" in export(log, "-o", target, "--loads", bad, status=2)
    assert not target.exists()
    nameless = tmp_path / "nameless.csv"
    nameless.write_text(log.read_text().replace(str(SKIN), "nowhere.toml"))
    assert "--skin" in export(nameless, "-o", target, status=2)
    export(nameless, "-o", target, "--skin", SKIN, "--taxels-only")
    assert "/suas/contacts" not in recorded(target)[0]
    assert "exists" in export(log, "-o", target, "--taxels-only", status=2)


def test_the_skin_of_the_file_is_the_one_attached(recording: Any, tmp_path: Path) -> None:
    _, _, attached = recording
    (tmp_path / "skin.toml").write_bytes(attached["suas.toml"])
    assert load_skin(tmp_path / "skin.toml") == load_skin(SKIN)


def test_contacts_lie_on_the_outer_face_of_any_section() -> None:
    """A flat top: straight up over the line, at the middle of the corner's arc."""
    corner = {"radius": "30 mm", "angle": "90 deg"}
    path = [{"line": "20 mm"}, corner, {"line": "27.5 mm"}]
    spec = shaped({"section": "path", "path": path, "mirror": True})
    face = messages.OuterFace(spec.geometry)
    for arc, place, direction in (
        (12e-3, (12e-3, 51.5e-3), 0.0),
        (
            27.5e-3 + 30e-3 * np.pi / 4,
            (27.5e-3 + 31.5e-3 * np.sqrt(0.5), 20e-3 + 31.5e-3 * np.sqrt(0.5)),
            np.pi / 4,
        ),
    ):
        found = face.at(Contact(0.0, 1.0, None, None, arc=arc, by_arc=True))
        assert found.position[:2] == pytest.approx(place, abs=1e-9)
        assert found.direction == pytest.approx(direction, abs=1e-9)
