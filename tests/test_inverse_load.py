"""Inverse load estimation against the solid model: bounds, coverage, faults, what can't be."""

import copy
import dataclasses
import itertools
import json
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import binom, chi2
from typer.testing import CliRunner

import benchmarks.inverse_load
from benchmarks import field_errors
from fitting.calibration.html_report import verify
from fitting.calibration.plan import Press
from fitting.cli.app import app
from fitting.inverse_load.check.section_log import section_verdict
from fitting.inverse_load.check.verdict import WIDTH
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate, load_array
from fitting.inverse_load.estimator import FULL_SCALE, LoadEstimator
from fitting.inverse_load.fit.explanation import Attempt
from fitting.inverse_load.fit.section_errors import SectionErrors
from fitting.inverse_load.frame_posterior import frame_posterior, likely_modes
from fitting.inverse_load.live.filter import LoadFilter
from fitting.inverse_load.live.live_loads import LiveLoads
from fitting.inverse_load.live.stream import live_frames
from fitting.inverse_load.readings import StepWatch, readings_of
from fitting.inverse_load.search.table import _solve
from fitting.statistics.posterior import Settings
from fitting.steps import finished
from suas_jax.acquisition.baseline import Baseline
from suas_jax.acquisition.device.device import Device
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.integrity import Flags
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.acquisition.stream import Judged
from suas_jax.config import continuous_inputs, load_skin
from suas_jax.config.input_errors import STIFFNESS, default_errors
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from tests.chains import assert_chain_agrees_with_the_mode

ROOT = Path(__file__).parent.parent
TAXELS = 40

runner = CliRunner()


@pytest.fixture(scope="module")
def study() -> ModuleType:
    """The benchmark, whose experiments these tests repeat in short."""
    return benchmarks.inverse_load


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the skin of 40 taxels; tables are cached in it."""
    path = tmp_path_factory.mktemp("invert")
    text = (ROOT / "configs/skins/suas.toml").read_text()
    # The readings are of this very skin: what it says is exact.
    exact = {
        'thickness    = "1.5 mm"': 'thickness = "1.5 mm +- 0"',
        'oil_gap      = "5 mm"': 'oil_gap = "5 mm +- 0"',
        'preset = "epdm-paper"': 'preset = "epdm-paper"\nC1 = "20.7 MPa +- 0"',
        "relative_permittivity = 2.2": 'relative_permittivity = "2.2 +- 0"',
        'lsb   = "0.305 fF"': 'lsb = "0.305 fF +- 0"',
    }
    for written, stated in exact.items():
        assert written in text
        text = text.replace(written, stated)
    rows = [
        f'{{ angle = "{angle!r} deg" }},' for angle in np.linspace(-80, 80, TAXELS).tolist()
    ]
    text = text[: text.index("taxels = [")] + "taxels = [\n" + "\n".join(rows) + "\n]\n"
    (path / "skin.toml").write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(path))
        yield path


@pytest.fixture(scope="module")
def estimator(folder: Path) -> Iterator[LoadEstimator]:
    """Of single contacts: the program for two of them takes as long again to compile."""
    with pytest.MonkeyPatch.context() as patch:
        # Of half as many forces: where a search begins, not where it ends.
        patch.setattr("fitting.inverse_load.search.table._FORCES", 12)
        yield LoadEstimator(load_skin(folder / "skin.toml"), most_contacts=1)


@pytest.fixture(scope="module")
def of_two(estimator: LoadEstimator) -> LoadEstimator:
    """Tells two contacts apart."""
    return LoadEstimator(estimator.spec, most_contacts=2)


@pytest.fixture(scope="module")
def truth(study: ModuleType) -> dict[str, Any]:
    """Readings of the solid model, made by the benchmark with --write."""
    lines = (ROOT / "tests/data/solid_contacts.csv").read_text().splitlines()[2:]
    sets: dict[str, list[tuple[list[float], list[float]]]] = {}
    for line in lines:
        kind, *fields = line.split(",")
        loads = [float(x) for x in fields[:6] if x]
        sets.setdefault(kind, []).append((loads, [float(x) for x in fields[6:]]))
    return {
        kind: study.Truth(
            np.array([loads for loads, _ in rows]).reshape(len(rows), -1, 3),
            np.array([so for _, so in rows]),
        )
        for kind, rows in sets.items()
    }


@pytest.fixture(scope="module")
def readings(estimator: LoadEstimator) -> Callable[..., np.ndarray]:
    """Exact readings of the estimator's own model under single loads [frame, taxel]."""

    def of(angle: float, force: float) -> np.ndarray:
        return _solve(estimator.skin, np.array([angle]), np.array([force]), None)[0].T

    return of


def test_single_contacts_of_the_solid_lie_in_the_stated_regions(
    study: ModuleType, truth: dict[str, Any], estimator: LoadEstimator
) -> None:
    found = estimator.estimate(study.measured(np.tile(truth["single"].so, (2, 1)), 1))
    loads = np.tile(truth["single"].loads[:, 0, :2], (2, 1))
    assert {e.status for e in found} == {"ok"}
    contacts = [c for e in found for c in e.contacts]
    off = np.array([(c.angle, c.force) for c in contacts]) - loads
    covariance = np.array([c.covariance for c in contacts])
    distance = np.einsum("fi,fij,fj->f", off, np.linalg.inv(covariance), off)
    assert 0.87 <= np.mean(distance < chi2.ppf(0.95, 2)) <= 0.99
    spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert np.all(np.sqrt(np.mean((off / spread) ** 2, 0)) < 1.2)
    assert np.median(np.abs(off[:, 0])) < np.deg2rad(0.2)
    assert np.median(np.abs(off[:, 1]) / loads[:, 1]) < 0.02
    assert 0.9 < np.mean([e.chi2_per_dof for e in found]) < 1.15
    outer = float(estimator.skin.geometry.outer_size[0])
    assert contacts[0].arc_position == pytest.approx(outer * contacts[0].angle)


@pytest.mark.long  # derivatives of the model for the bound; stated regions above
def test_single_contacts_of_the_solid_reach_the_bound(
    study: ModuleType,
    truth: dict[str, Any],
    estimator: LoadEstimator,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The bound is that of contacts which are known to be radial lines.
    monkeypatch.setattr(estimator.selection.fitter, "left_out", None)
    so, loads = truth["single"].so, truth["single"].loads
    found = estimator.estimate(study.measured(np.tile(so, (4, 1)), 1))
    loads = np.tile(loads, (4, 1, 1))
    judged = study.score(estimator, found, loads)
    assert judged.right.all()
    assert {e.status for e in found} == {"ok"}
    assert (judged.ratio < 1.2).all()
    angle, force = judged.median(loads)
    assert angle < 0.2
    assert force < 0.02
    assert 0.90 <= judged.covered.mean() <= 0.99
    assert 0.9 < np.mean([e.chi2_per_dof for e in found]) < 1.15


@pytest.mark.long  # the program of two contacts; pairs in test_load_formulas
def test_two_contacts_are_told_apart(
    study: ModuleType,
    truth: dict[str, Any],
    of_two: LoadEstimator,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(of_two.selection.fitter, "left_out", None)  # as of the bound
    found = of_two.estimate(study.measured(truth["two"].so, 2))
    judged = study.score(of_two, found, truth["two"].loads)
    assert judged.right.mean() >= 0.95
    assert (judged.ratio < 1.2).all()
    assert 0.87 <= judged.covered.mean() <= 0.99


@pytest.mark.long  # the program of free directions; what bends in test_load_formulas
def test_contacts_of_free_direction_lie_in_the_stated_regions(
    study: ModuleType, truth: dict[str, Any], estimator: LoadEstimator
) -> None:
    free = LoadEstimator(estimator.spec, direction=True, most_contacts=1)
    so, loads = (np.tile(x, (5, 1)) for x in (truth["turned"].so, truth["turned"].loads[:, 0]))
    found = free.estimate(study.measured(so, 0))
    off = np.array([(c.angle, c.force, c.direction) for e in found for c in e.contacts]) - loads
    covariance = np.array([e.contacts[0].covariance for e in found])
    distance = np.einsum("fi,fij,fj->f", off, np.linalg.inv(covariance), off)
    inside = distance < chi2.ppf(0.95, 3)
    assert 0.91 <= inside.mean() <= 0.99  # 0.83 by the tangent alone
    far = np.abs(loads[:, 0]) > np.deg2rad(45)
    assert inside[far].mean() > 0.8  # 0.5 by the tangent alone


def test_a_reading_that_is_a_little_off_is_no_touch(estimator: LoadEstimator) -> None:
    """Seven deviations are too little for the gaps of the other taxels to tell."""
    random, noise = np.random.default_rng(0), estimator.reading_noise
    so = estimator.model_rest + noise * random.normal(size=(200, estimator.taxels))
    so[np.arange(200), random.integers(0, estimator.taxels, 200)] += 7 * noise
    found = estimator.estimate(np.round(so))
    assert sum(e.contact is not False for e in found) < 20


def test_false_alarms_come_at_the_stated_rate(
    study: ModuleType, estimator: LoadEstimator
) -> None:
    frames = 1000
    counts = study.measured(np.tile(estimator.table.rest, (frames, 1)), 3)
    counts[: frames // 2, ::3] = np.nan  # missing taxels change the threshold, not the rate
    alarms = sum(e.contact is not False for e in estimator.estimate(counts))
    low, high = binom.ppf((0.001, 0.999), frames, estimator.false_alarm)
    assert low <= alarms <= high


@pytest.mark.parametrize(("taxels", "off"), [((22,), 500.0), ((22,), -25.0), ((5, 22), 3000.0)])
def test_taxels_that_are_off_at_rest_are_no_contact(
    study: ModuleType, estimator: LoadEstimator, taxels: tuple[int, ...], off: float
) -> None:
    """They were a contact in every frame, `imprecise`, `at_edge`, `poor_fit` or `pull`."""
    counts = study.measured(np.tile(estimator.table.rest, (20, 1)), 4)
    counts[:, taxels] += off
    found = estimator.estimate(counts)
    assert sum(e.contact is False and e.left_out == taxels for e in found) >= 18
    assert not any(e.status == "ok" for e in found)


@pytest.mark.long  # two contacts; faults in test_load_formulas
def test_stuck_and_missing_taxels_cost_little(
    study: ModuleType, truth: dict[str, Any], of_two: LoadEstimator
) -> None:
    loads = truth["single"].loads
    counts = study.measured(truth["single"].so, 4)
    clean = study.score(of_two, of_two.estimate(counts), loads)
    counts[:, [3, 17, 30]] = np.nan
    counts[:, [8, 24]] = np.round(of_two.table.rest[[8, 24]])
    found = of_two.estimate(counts)
    judged = study.score(of_two, found, loads)
    assert judged.right.mean() >= 0.95
    rms = [np.sqrt(((s.errors / s.bound) ** 2).mean()) for s in (clean, judged)]
    assert rms[1] < 2 * rms[0]
    assert all({3, 17, 30} <= set(e.left_out) for e in found)


def test_frames_without_a_contact_have_statuses_of_their_own(estimator: LoadEstimator) -> None:
    rest = estimator.table.rest
    saturated = np.full(TAXELS, FULL_SCALE)
    few = np.full(TAXELS, np.nan)
    few[:3] = rest[:3]
    found = estimator.estimate(np.stack([saturated, few]))
    assert [e.status for e in found] == ["saturated", "too_few_taxels"]
    assert [e.contact for e in found] == [None] * 2
    assert not any(e.contacts for e in found)


@pytest.mark.long  # every other explanation is tried; statuses in test_load_formulas
def test_readings_of_another_skin_have_a_status_of_their_own(
    estimator: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    (found,) = estimator.estimate(1.3 * readings(0.4, 12.0) + 20.0)
    assert (found.status, found.contact, found.contacts) == ("model_mismatch", None, ())


@pytest.mark.long  # two contacts; left-out taxels in test_load_formulas
def test_a_stuck_taxel_is_left_out_and_none_of_its_sound_neighbours(
    truth: dict[str, Any], of_two: LoadEstimator
) -> None:
    """Two contacts are cheaper with one taxel left out than with five."""
    rows, stuck = np.array([2, 7, 13, 27]), np.array([18, 34, 4, 8])
    counts = np.round(truth["two"].so[rows])
    counts[range(4), stuck] = np.round(of_two.table.rest[stuck])
    found = of_two.estimate(counts)
    assert [e.left_out for e in found] == [(taxel,) for taxel in stuck]
    assert [len(e.contacts) for e in found] == [2] * 4


@pytest.mark.long  # two contacts; selection in test_load_formulas
def test_a_contact_without_a_force_to_speak_of_is_taken_out_again(
    of_two: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    selection = of_two.selection
    y, weight = of_two.weigh(np.round(readings(0.3, 12.0)))
    node, _ = selection.nodes.nearest(y, weight)
    state = selection.fitter.table.start(node)
    start = np.array([[0.3, 0.9, 11.8, 0.05]])
    two = finished(selection.several.fit(Attempt(y, weight, start, state, 2)))
    lost = dataclasses.replace(two, chi2=two.chi2 + 1e6, score=two.chi2 + 1e6)
    one = finished(selection.several.without_weakest(y, weight, np.zeros(1, int), two, lost))
    assert (two.score[0], one.contacts[0]) == (np.inf, 1)
    np.testing.assert_allclose(one.parameters[0, :2], [0.3, 12.0], rtol=3e-3)
    assert one.score[0] == pytest.approx(two.chi2[0], abs=1.0)


@pytest.mark.long  # the program of wide contacts; pulls in test_load_formulas
def test_a_pull_is_a_negative_force(
    estimator: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    found = estimator.estimate(readings(0.35, -6.0))[0]
    assert found.status == "pull"
    (contact,) = found.contacts
    assert contact.angle == pytest.approx(0.35, abs=1e-3)
    assert contact.force == pytest.approx(-6.0, rel=1e-3)


@pytest.mark.long  # the program of wide contacts; bounds and statuses in test_estimate_formulas
def test_wall_contact_states_no_error(
    estimator: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    so = readings(np.pi / 4, 45.0)
    so = np.where(np.isfinite(so), np.minimum(so, FULL_SCALE), FULL_SCALE)
    found = estimator.estimate(so)[0]
    assert found.status == "wall_contact"
    assert found.wall_contact
    assert all(contact.covariance is None for contact in found.contacts)
    # The corrected shell touches there at 38.1 N; 95 % sure is a little less.
    assert 0.97 * 38.1 < found.at_least < 38.2
    assert found.status_text.startswith("saturated by wall contact: at least 3")


@pytest.mark.long  # an estimator with errors; systematic parts in test_load_formulas
def test_errors_of_a_calibration_are_covered_as_stated(estimator: LoadEstimator) -> None:
    """True skins are drawn from the record; regions hold the load, and noise alone doesn't."""
    sigma = {"oil_gap": 1e-4, "relative_permittivity": 0.04}
    paths = ("geometry.oil_gap", "oil.relative_permittivity")
    own = continuous_inputs(estimator.spec)
    record = CalibrationSpec(
        parameters=tuple(sigma),
        values=tuple(float(own[path]) for path in paths),
        covariance=tuple(tuple(row) for row in np.diag(np.square(list(sigma.values())))),
    )
    drawn = estimator.spec  # what its file calls exact would count as exact
    spec = drawn.model_copy(
        update={
            "geometry": drawn.geometry.model_copy(update={"oil_gap": record.values[0]}),
            "oil": drawn.oil.model_copy(update={"relative_permittivity": record.values[1]}),
            "calibration": record,
        }
    )
    rest = np.asarray(estimator.model_rest)
    calibrated = LoadEstimator(spec, most_contacts=1, rest=rest)
    random, angle, force = np.random.default_rng(7), 0.3, 12.0
    squares, noise_only = [], []
    for _ in range(8):
        changes = {
            path: size * random.normal() / float(own[path])
            for path, size in zip(paths, sigma.values(), strict=True)
        }
        true = field_errors.Case("", changes)
        pressed, at_rest = field_errors.true_readings(spec, true, np.array([[angle, force]]))
        so = pressed - at_rest + rest + random.normal(0, 2, (2, TAXELS))
        for estimate in calibrated.estimate(so):
            assert estimate.status == "ok"
            (contact,) = estimate.contacts
            off = np.array([contact.angle - angle, contact.force - force])
            assert contact.covariance is not None
            assert contact.noise_covariance is not None
            squares.append(off @ np.linalg.solve(contact.covariance, off))
            noise_only.append(off @ np.linalg.solve(contact.noise_covariance, off))
    assert max(squares) < chi2.ppf(0.9999, 2)
    assert 0.2 < np.median(squares) / chi2.ppf(0.5, 2) < 2
    assert np.median(noise_only) > 2 * np.median(squares)


@pytest.mark.long  # an estimator with errors, four times
@pytest.mark.parametrize("name", ["thickness +5 %", "C1 -10 %", "gap +3 %", "gain +1 %"])
def test_a_skin_within_its_tolerances_gives_no_wrong_answer(
    estimator: LoadEstimator, name: str
) -> None:
    """The default tolerances cover what the field brings; noise alone doesn't."""
    case = next(case for case in field_errors.CASES if case.name == name)
    random = np.random.default_rng(5)
    loads = field_errors.drawn(6, random)
    spec = field_errors.with_tolerances(estimator.spec, exact=False)
    estimator, so = field_errors.estimated(spec, case, loads, random, most_contacts=2)
    found = estimator.estimate(so)
    assert {e.status for e in found} <= {"ok", "imprecise"}
    assert not any(map(field_errors.is_wrong, found, loads))
    off = np.array([e.contacts[0].force for e in found]) - loads[:, 1]
    covariances = np.array([e.contacts[0].noise_covariance for e in found])
    beyond = np.abs(off) > 3.3 * np.sqrt(covariances[:, 1, 1])
    assert name == "gain +1 %" or beyond.mean() > 0.6


@pytest.mark.long  # the program of wide contacts
def test_a_wide_contact_is_one_contact_with_its_width(estimator: LoadEstimator) -> None:
    case = next(case for case in field_errors.CASES if case.width and case.baseline)
    random = np.random.default_rng(8)
    loads = field_errors.drawn(8, random)
    spec = field_errors.with_tolerances(estimator.spec, exact=False)
    own, so = field_errors.estimated(spec, case, loads, random, most_contacts=2)
    found = own.estimate(so)
    assert not any(map(field_errors.is_wrong, found, loads))
    assert all(len(e.contacts) == 1 for e in found)
    # Of a light contact the width is less than its noise.
    strong = [
        e for e, load in zip(found, loads, strict=True) if load[1] > 10 and abs(load[0]) < 1
    ]
    assert strong
    for estimate in strong:
        (contact,) = estimate.contacts
        assert contact.spread is not None
        length, error = contact.spread
        assert abs(length - case.width) < 4 * error
        assert error < 0.2 * case.width


@pytest.mark.long  # the program of contacts that are no radial line
def test_an_inclined_force_is_one_contact_with_its_tangential_force(
    study: ModuleType, truth: dict[str, Any], of_two: LoadEstimator
) -> None:
    """Friction turns forces: half of them were told as two contacts or more, many at `ok`.

    Where two explain the readings nearly as well, they are alternatives.
    """
    loads = truth["turned"].loads[:, 0]
    rows = np.abs(loads[:, 0]) < np.deg2rad(38)  # where readings show tangential forces
    so, (_, force, turn) = truth["turned"].so[rows], loads[rows].T
    found = of_two.estimate(study.measured(so, 0))
    right = np.array([len(e.contacts) == 1 for e in found])
    assert right.sum() >= len(found) - 1
    assert not any(e.status == "ok" for e in np.array(found)[~right])
    assert {len(e.alternatives) for e in found if e.status == "ambiguous"} == {2}
    assert 2 * sum(e.status == "ok" for e in found) > len(found)
    (contacts,) = zip(*(e.contacts for e in found if len(e.contacts) == 1), strict=True)
    force, turn = force[right], turn[right]
    off = [c.force for c in contacts] - force * np.cos(turn)
    deviation = np.array([c.deviation("force") for c in contacts])
    assert ((off / deviation) ** 2).mean() < 1.5**2
    told = np.array([c.arc_force or (np.nan, np.nan) for c in contacts])
    assert np.isfinite(told[np.abs(force * np.sin(turn)) > 1]).all()
    assert np.nanmax(np.abs(told[:, 0] - force * np.sin(turn)) / told[:, 1]) < 4


@pytest.mark.long  # estimators with errors; verdicts in test_load_formulas
@pytest.mark.parametrize(
    ("name", "cause", "change"),
    [
        ("gap +3 %", "geometry.oil_gap", 0.03),
        ("C1 -10 %, forces known", "stiffness of the material", -0.127),
        ("columns shifted by one", None, None),
        ("as in the file", None, None),
    ],
)
def test_a_log_names_what_is_wrong_with_its_skin_file(
    estimator: LoadEstimator, name: str, cause: str | None, change: float | None
) -> None:
    case = next(case for case in field_errors.CASES if case.name == name)
    random = np.random.default_rng(9)
    loads = field_errors.drawn(24, random)
    own, so = field_errors.estimated(estimator.spec, case, loads, random, most_contacts=1)
    force = loads[:, 1] if case.force_known else None
    faulty = np.zeros(so.shape, bool)
    verdict = section_verdict(own, so, faulty, own.estimate(so), force=force)
    assert verdict is not None
    assert (verdict.name, verdict.shift) == (cause, -case.shift)
    assert verdict.right is (name == "as in the file")
    assert bool(verdict.command("skin.toml", "log.csv")) is not verdict.right
    if change is not None:
        assert verdict.change == pytest.approx(change, abs=max(4 * verdict.error, 0.003))


@pytest.mark.long  # estimators with errors; verdicts in test_load_formulas
@pytest.mark.parametrize(
    ("path", "by", "baseline"),
    [
        ("geometry.thickness", -0.12, True),
        ("geometry.oil_gap", -0.09, False),
        ("electrodes.lsb", 0.05, False),
    ],
)
def test_a_number_far_off_is_not_blamed_on_another(
    estimator: LoadEstimator, path: str, by: float, baseline: bool
) -> None:
    """There readings are no longer linear in it: to first order another explains more."""
    case = field_errors.Case("", {path: by}, baseline)
    random = np.random.default_rng(12)
    loads = field_errors.drawn(40, random)
    own, so = field_errors.estimated(estimator.spec, case, loads, random, most_contacts=1)
    verdict = section_verdict(own, so, np.zeros(so.shape, bool), own.estimate(so))
    assert verdict is not None
    found = {verdict.name: verdict, **{other.name: other for other in verdict.others}}
    assert path in found
    assert found[path].change == pytest.approx(by, abs=max(4 * found[path].error, 0.003))
    # Permittivity and scale do the same where readings have no stray part, a gap nearly so.
    if path == "electrodes.lsb":
        assert "oil.relative_permittivity" in found
    else:
        assert len(found) == 1


def test_forces_count_the_friction_that_readings_do_not_show(
    study: ModuleType, truth: dict[str, Any], estimator: LoadEstimator
) -> None:
    loads = truth["turned"].loads[:, 0]
    rows = np.abs(loads[:, 0]) > np.deg2rad(38)  # where radial forces explain inclined ones
    so, (_, force, turn) = truth["turned"].so[rows], loads[rows].T
    found = estimator.estimate(study.measured(so, 0))
    told = np.array([e.status == "ok" for e in found])
    assert told.sum() >= len(found) - 2
    contacts = [e.contacts[0] for e in found]
    off = (np.array([c.force for c in contacts]) - force * np.cos(turn))[told]
    deviation = np.array([c.deviation("force") for c in contacts])[told]
    # As radial forces they are off by 16 deviations, one by 17 %.
    assert ((off / deviation) ** 2).mean() < 2**2
    assert np.abs(off / force[told]).max() < 0.12


def test_friction_and_width_beside_contacts_without_force_are_those_of_one(
    estimator: LoadEstimator,
) -> None:
    fitter = estimator.selection.fitter
    table, left_out = fitter.table, fitter.left_out  # type: ignore[attr-defined]
    place, level = table.so.shape[0] // 3, table.so.shape[1] // 2
    node = np.array([place * table.so.shape[1] + level])
    x = np.array([[table.angles[place], 0.2, table.forces[place, level], 0.0]])
    found = left_out._under_several(x, table.start(node))[0]
    assert not found[[1, 3]].any()
    by_tangent, by_square = table.slopes[place, level, 2:]
    np.testing.assert_allclose(found[0], by_tangent, atol=1e-3 * np.abs(by_tangent).max())
    np.testing.assert_allclose(found[2], by_square, atol=1e-9 * np.abs(by_square).max())


@pytest.mark.long  # the program of two contacts; what it takes of friction above
def test_regions_of_two_contacts_count_the_friction_of_both(of_two: LoadEstimator) -> None:
    random = np.random.default_rng(5)
    angle = np.deg2rad(random.uniform([[-55], [5]], [[-10], [55]], (2, 120)))
    inward, tangent = random.uniform(3, 12, angle.shape), random.uniform(-0.4, 0.4, angle.shape)
    skin = of_two.skin

    def readings(inward: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        total, turn = np.hypot(1, tangent) * inward, np.arctan(tangent)
        so = forward(skin, Loads(*map(jnp.asarray, (angle, total, turn)), jnp.zeros(120))).so
        return np.asarray(so).T

    radial = readings(inward, 0 * tangent)
    ones = np.ones((len(radial), TAXELS))
    asked = Attempt(radial, ones, np.concatenate([angle, inward]).T, None, 2)
    rest = of_two.selection.nodes.rest_states(len(radial))
    fit = finished(of_two.selection.fitter.steps(asked._replace(state=rest)))
    slopes = of_two.selection.fitter.left_out.slopes(fit, 2, 2)[:, :2]  # type: ignore[union-attr]
    first = 1e-2 * np.array([[1.0], [0.0]])
    change = (readings(inward, first + 0 * angle) - readings(inward, 0 * angle - first)) / 2e-2
    size = np.abs(change).max(1, keepdims=True)
    assert np.abs((slopes[:, 0] - change) / size).max() < 2e-2
    so = readings(inward, tangent) + 2 * random.normal(size=radial.shape)
    inside = []
    for k, estimate in enumerate(of_two.estimate(np.round(so))):
        if estimate.status == "ok" and len(estimate.contacts) == 2:
            for contact, own in zip(estimate.contacts, (0, 1), strict=True):
                off = [contact.angle - angle[own, k], contact.force - inward[own, k]]
                assert contact.covariance is not None
                region = np.array(off) @ np.linalg.solve(contact.covariance, np.array(off))
                inside.append(region < chi2.ppf(0.95, 2))
    assert len(inside) > 100
    assert np.mean(inside) > 0.7  # 0.5 as if each contact were alone


def as_line(contact: Contact) -> Contact:
    return dataclasses.replace(contact, spread=None)


@pytest.mark.long  # estimators with errors; verdicts in test_load_formulas
def test_wide_contacts_are_named_before_a_number_of_the_skin(estimator: LoadEstimator) -> None:
    case = field_errors.Case("", {}, width=16e-3)
    random = np.random.default_rng(5)
    loads = field_errors.drawn(40, random)
    own, so = field_errors.estimated(estimator.spec, case, loads, random, most_contacts=1)
    lines = [
        dataclasses.replace(e, contacts=tuple(map(as_line, e.contacts)))
        for e in own.estimate(so)
    ]
    verdict = section_verdict(own, so, np.zeros(so.shape, bool), lines)
    assert verdict is not None
    assert verdict.name == WIDTH
    assert verdict.change == pytest.approx(case.width, rel=0.15)


@pytest.mark.long  # the program of wide truths; the mean over widths in test_load_formulas
def test_regions_count_the_width_that_readings_do_not_show(estimator: LoadEstimator) -> None:
    random = np.random.default_rng(5)
    loads, spec = field_errors.drawn(120, random), estimator.spec
    so = [
        field_errors.true_readings(spec, field_errors.Case("", {}, width=w), loads)[:-1]
        for w in (0.0, 3e-3, 9e-3)
    ]
    # What the table says of a narrow arc is what it does.
    found = estimator.estimate(so[0])
    fit = estimator.selection.of_one.explain(*estimator.weigh(so[0]))[0]
    by_square = estimator.selection.fitter.left_out.slopes(fit, 2, 1)[:, 1]  # type: ignore
    change = (so[1] - so[0]) / 9e-6
    size = np.abs(change).max(1)
    assert np.median(np.abs(by_square - change).max(1) / size) < 0.1
    found = estimator.estimate(np.round(so[2] + 2 * random.normal(size=so[2].shape)))
    inside = []
    for estimate, (angle, force) in zip(found, loads, strict=True):
        if estimate.status == "ok" and len(estimate.contacts) == 1:
            contact = estimate.contacts[0]
            off = np.array([contact.angle - angle, contact.force - force])
            assert contact.covariance is not None
            inside.append(off @ np.linalg.solve(contact.covariance, off) < chi2.ppf(0.95, 2))
    assert len(inside) > 100
    assert np.mean(inside) > 0.9  # 0.8 as lines


@pytest.mark.long  # estimators with errors; verdicts in test_load_formulas
def test_a_shift_is_named_where_it_makes_most_contacts_look_wide_or_double(
    estimator: LoadEstimator,
) -> None:
    case = field_errors.Case("", {}, shift=2)
    random = np.random.default_rng(3)
    loads = field_errors.drawn(24, random)
    own, so = field_errors.estimated(estimator.spec, case, loads, random, most_contacts=2)
    estimates = own.estimate(so)
    assert sum(len(e.contacts) < 2 and e.status == "ok" for e in estimates) < 12
    verdict = section_verdict(own, so, np.zeros(so.shape, bool), estimates)
    assert verdict is not None
    assert verdict.shift == -2


@pytest.mark.long  # the program of errors; systematic parts in test_load_formulas
def test_errors_of_the_stiffness_scale_forces_up_to_the_wall(estimator: LoadEstimator) -> None:
    """Readings depend on force over stiffness alone, however steep they are near the wall."""
    errors = SectionErrors(
        default_errors(estimator.spec),
        estimator.skin,
        estimator.table,
        from_rest=False,
        live=False,
    )
    stiffness = errors.names.index(STIFFNESS)
    random = np.random.default_rng(1)
    table = estimator.table
    angle = random.uniform(-1.2, 1.2, 63)
    largest = np.interp(angle, table.angles, table.forces[:, -1])
    loads = np.stack([angle, random.uniform(0.05, 0.99, 63) * largest], 1)
    fitter = estimator.selection.fitter
    nodes = estimator.selection.nodes
    so = field_errors.true_readings(estimator.spec, field_errors.Case("", {}), loads)[:-1]
    weight = np.ones(so.shape)
    first, _ = nodes.nearest(so, weight)
    fit = fitter.fit(so, weight, nodes.near(so, weight, first), nodes.states(first), 1)
    by_force = fit.jacobian[:, 1] * fit.parameters[:, 1:2]
    slopes = errors.under_one(*fit.parameters[:, :2].T, fit.jacobian[:, :2])[:, stiffness]
    size = np.abs(by_force).max(1, keepdims=True)
    np.testing.assert_allclose(slopes / size, -0.1 * by_force / size, atol=2e-5)


@pytest.mark.long  # an estimator with errors; significance beside errors in test_load_formulas
def test_a_wrong_gap_raises_no_alarm_at_rest(estimator: LoadEstimator) -> None:
    case = field_errors.Case("", {"geometry.oil_gap": 0.03}, baseline=False)
    random = np.random.default_rng(6)
    spec = field_errors.with_tolerances(estimator.spec, exact=False)
    own, so = field_errors.estimated(spec, case, np.zeros((40, 2)), random, most_contacts=2)
    assert sum(e.contact is not False for e in own.estimate(so)) <= 3
    # Taken as exact, most frames are contacts; the others rest but for one taxel.
    assert sum(e.contact is not False for e in estimator.estimate(so)) > 20


def test_filter_follows_a_sliding_contact() -> None:
    random, sigma = np.random.default_rng(0), np.array([0.02, 0.3])
    track, errors, raw = LoadFilter(angle_density=0.01, force_density=1.0), [], []
    for k in range(300):
        t = 0.01 * k
        true = np.array([-0.5 + 0.4 * t, 8.0 + 1.0 * t])
        seen = true + random.normal(0, sigma)
        contact = Contact(seen[0], seen[1], None, np.diag(sigma**2))
        (smooth,) = track.feed(t, LoadEstimate(True, (contact,), status="ok"))
        assert smooth.covariance is not None
        spread = np.sqrt(np.diag(smooth.covariance))
        errors.append((np.array([smooth.angle, smooth.force]) - true) / spread)
        raw.append(spread / sigma)
    settled = np.array(errors[100:])
    assert (np.array(raw[100:]) < 0.5).all()
    assert (np.sqrt((settled**2).mean(0)) < 1.4).all()


def test_filter_is_the_gaussian_process_of_a_random_acceleration() -> None:
    """At times s <= t it has the covariance V s t + q (s^2 t / 2 - s^3 / 6) of two places."""
    names, rates = ("angle", "axial", "force"), np.array([1.0, 3.5e-3, 400.0])  # V
    densities, noise, lasting = 150 * rates, 4e-4 * rates, 1e-4 * rates
    time = np.array([0.0, 0.02, 0.07, 0.08])
    seen = 0.5 + np.array([0.0, 0.9, 2.5, 1.7])[:, None] * np.sqrt(noise)
    track = LoadFilter(*densities[[0, 2, 1]])
    for k, (t, row) in enumerate(zip(time, seen, strict=True)):
        values = dict(zip(names, row, strict=True))
        contact = Contact(
            **values,
            direction=None,
            covariance=np.diag(noise + lasting),
            systematic=np.diag(lasting),
        )
        (found,) = track.feed(t, LoadEstimate(True, (contact,), status="ok"))
        s, longer = (
            f.outer(time[1 : k + 1], time[1 : k + 1]) for f in (np.minimum, np.maximum)
        )
        for i, name in enumerate(names):
            # The track begins at the first estimate; later ones correct it.
            prior = noise[i] + rates[i] * s * longer
            prior += densities[i] * (s**2 * longer / 2 - s**3 / 6)
            gain = np.linalg.solve(prior + noise[i] * np.eye(k), prior)
            mean = seen[0, i] + gain.T @ (seen[1 : k + 1, i] - seen[0, i])
            left = prior - prior @ gain
            expected = (mean[-1], left[-1, -1]) if k else (seen[0, i], noise[i])
            scale = np.sqrt(noise[i])
            assert found.covariance is not None
            assert getattr(found, name) == pytest.approx(expected[0], abs=1e-3 * scale)
            stated = found.covariance[i, i] - lasting[i]
            assert stated == pytest.approx(expected[1], rel=1e-3)


def fed(track: LoadFilter, time: float, *contacts: Contact) -> list[Contact]:
    return track.feed(time, LoadEstimate(True, contacts, status="ok"))


@pytest.mark.parametrize(("squared", "followed"), [(24.5, True), (25.5, False)])
def test_filter_follows_within_five_standard_deviations(squared: float, followed: bool) -> None:
    """Of the difference of two estimates of one moment, equally uncertain: the half way."""
    track, covariance = LoadFilter(), np.diag([1e-4, 0.04])
    first = Contact(0.1, 5.0, None, covariance)
    apart = np.sqrt(2 * covariance[1, 1] * squared)
    fed(track, 3.0, first)
    (found,) = fed(track, 3.0, Contact(0.1, 5.0 + apart, None, covariance))
    assert found.force == pytest.approx(5.0 + (0.5 if followed else 1.0) * apart, rel=1e-12)
    assert found.covariance is not None
    left = 0.5 if followed else 1.0
    np.testing.assert_allclose(found.covariance, left * covariance, rtol=1e-12, atol=1e-18)


def test_filter_takes_a_frame_stamped_too_early_for_one_of_the_same_moment() -> None:
    covariance = np.diag([1e-4, 0.04])
    for early in (0.0, 0.3, 2.0):
        track = LoadFilter()
        for time, angle in ((3.0, 0.1), (3.0 - early, 0.11)):
            (found,) = fed(track, time, Contact(angle, 5.0, None, covariance))
        assert found.angle == pytest.approx(0.105, rel=1e-12)


def test_filter_leaves_out_contacts_whose_error_is_unknown() -> None:
    good = np.diag([1e-4, 0.04])
    contacts = [
        Contact(-0.5, 5.0, None, None),
        Contact(0.1, 5.0, None, np.diag([np.inf, 0.04])),
        Contact(0.5, 6.0, None, good),
    ]
    (found,) = fed(LoadFilter(), 0.0, *contacts)
    assert (found.angle, found.force) == (0.5, 6.0)


def test_filter_follows_neither_directions_nor_diameters() -> None:
    """Their rows lie between and behind those of angle, axial position and force."""
    whole = np.diag([1e-4, 2e-8, 0.04, 1e-6, 3e-4]) + 1e-9
    contact = Contact(0.1, 5.0, 0.2, whole, systematic=0.25 * whole, axial=0.01, diameter=0.005)
    (found,) = fed(LoadFilter(), 0.0, contact)
    assert (found.angle, found.force, found.axial) == (0.1, 5.0, 0.01)
    np.testing.assert_allclose(found.covariance, whole[:3, :3], rtol=1e-12)


def test_filter_expects_contacts_to_slide_as_fast_along_a_pad_as_around_it() -> None:
    """A radian of the skin's outer face, of radius 59 mm, is 59 mm."""
    track, covariance = LoadFilter(), np.diag([1e-4, 1e-4 * 0.059**2, 0.04])
    for time in (0.0, 0.02, 0.5, 2.0, 2.01):
        (found,) = fed(track, time, Contact(0.1, 5.0, None, covariance, axial=0.0))
        assert found.covariance is not None
        around, along = np.diag(found.covariance)[:2]
        assert along == pytest.approx(0.059**2 * around, rel=0.01)


class _Played:
    """Stands in for a stream: batches of readings, stamped by a clock that the test sets."""

    waiting = False

    def __init__(self, batches: Iterable[list[Judged]]) -> None:
        self._batches = batches

    def batches(self) -> Iterator[list[Judged]]:
        yield from self._batches


def _tapped(
    steady: dict[float, np.ndarray], electrodes: Any, push: Callable[[float], float]
) -> tuple[np.ndarray, np.ndarray]:
    """Times and readings of a skin that swings in the shapes of steady contacts.

    Those are given by their forces. The shapes' amplitude a obeys
    a'' + 2 d w a' = w^2 (f - F(a)) a1 / F(a1), with w and d of the lowest mode of
    `configs/scenes/film.toml`, F(a) the steady force and a1 the amplitude of the lightest.
    """
    force = np.array(list(steady))
    gap = np.asarray(electrodes.even_film(np.array(list(steady.values())).T)).T
    shape = gap[1] - gap[0]
    amplitude = (gap - gap[0]) @ shape / (shape @ shape)
    w, d = 2 * np.pi * 2.42, 0.7

    def rate(t: float, y: np.ndarray) -> list[float]:
        back = np.interp(y[0], amplitude, force) + min(y[0], 0.0) * force[1]
        return [y[1], w**2 * (push(t) - back) / force[1] - 2 * d * w * y[1]]

    times = np.arange(0.0, 2.0, 0.01)
    swing = solve_ivp(rate, (0, times[-1]), [0.0, 0.0], t_eval=times, max_step=2e-3).y[0]
    levels = [np.interp(swing, amplitude, column) for column in gap.T]
    moved = np.stack(levels, 1) + np.minimum(swing, 0.0)[:, None] * shape
    readings = np.asarray(electrodes.read_even_film(moved.T)).T
    return times, np.rint(readings + np.random.default_rng(0).normal(0.0, 2.0, readings.shape))


def test_a_tap_is_told_by_its_impulse_and_no_frame_of_it_is_ok(
    estimator: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    of_film = copy.copy(estimator)
    of_film._film = of_film._film_of(0.1)
    place = np.deg2rad(10.0)
    steady = {f: readings(place, f)[0] for f in np.linspace(0.1, 9.0, 30).tolist()}
    steady = {0.0: of_film.model_rest, **steady}

    def told(push: Callable[[float], float]) -> tuple[np.ndarray, list[LoadEstimate]]:
        times, so = _tapped(steady, of_film.skin.electrodes, push)
        return times, of_film.estimate(so, time=times)

    times, found = told(lambda t: 4.0 * np.sin(np.pi * (t - 0.3) / 0.06) * (0.3 < t < 0.36))
    assert {e.status for e in found} == {"no_contact", "moving"}
    (tap,) = [e.tap for e in found if e.tap is not None]
    impulse = 4.0 * 0.06 * 2 / np.pi
    assert tap.time == pytest.approx(0.3, abs=0.03)
    assert tap.impulse == pytest.approx(impulse, rel=0.06)
    assert tap.impulse == pytest.approx(impulse, abs=2 * tap.deviation)
    assert tap.place.angle == pytest.approx(place, abs=0.01)
    # A press that stays shows its force once the film has followed, and its tap never.
    times, found = told(lambda t: 4.0 * (t > 0.3))
    assert not any(e.tap for e in found)
    held = [e for t, e in zip(times, found, strict=True) if t > 0.4]
    for estimate in held:
        (contact,) = estimate.contacts
        assert contact.force == pytest.approx(4.0, abs=3 * contact.deviation("force"))
    assert {e.status for e in held[:10]} == {"moving"}
    assert {e.status for e in held[-60:]} == {"ok"}


def test_a_stream_drops_what_has_waited_and_refuses_other_layouts(
    estimator: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    counts = tuple(int(x) for x in np.round(readings(0.2, 10.0)[0]))
    arrivals = [9.0, 9.99, 9.995, 9.999]  # the second is the newest of its batch
    frames = [
        Judged(
            Reading(k, 0.01 * k, 0, counts if k < 3 else (*counts, 1), t_host=t),
            0.01 * k,
            Flags(),
        )
        for k, t in enumerate(arrivals)
    ]
    stream: Any = _Played([frames[:2], frames[2:]])
    found = list(live_frames(stream, estimator, latency=0.1, smooth=True, clock=lambda: 10.0))
    assert [f.seq for f in found] == [1, 2, 3]
    assert [f.dropped for f in found] == [1, 1, 1]
    assert [f.estimate.status for f in found] == ["ok", "ok", "layout_mismatch"]
    assert found[1].filtered is not None
    assert np.rad2deg(found[1].filtered[0].angle) == pytest.approx(np.rad2deg(0.2), abs=0.3)
    assert found[0].estimate.latency == pytest.approx(0.01)


def code_of_page(words: str) -> str:
    """The code block of docs/inverse_load.md that holds some words."""
    page = (ROOT / "docs/inverse_load.md").read_text(encoding="utf-8")
    (block,) = (b for b in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if words in b)
    return str(block)


class _EnoughError(Exception):
    """Ends a control loop that would go on for ever."""


@pytest.mark.long  # the program of single frames; streams and refusals below
def test_the_control_loop_of_the_page(
    folder: Path,
    estimator: LoadEstimator,
    readings: Callable[..., np.ndarray],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Degrees and radians in the names, loads as an array, a busy port, the port let go."""
    from fitting import live_loads

    counts = readings(0.2, 10.0)[0]
    random = np.random.default_rng(5)
    noisy = (np.rint(counts + random.normal(0, 2, TAXELS)) for _ in itertools.count())
    frames = (Reading(k, 0.01 * k, 0, tuple(map(int, so))) for k, so in enumerate(noisy))
    ended = threading.Event()
    seen: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    space: dict[str, Any] = {}

    def steer(*arguments: np.ndarray) -> None:
        if not seen:
            with pytest.raises(OSError, match="busy"):
                live_loads("skin.toml", "port", frame_format="cobs")
        seen.append(arguments)
        if len(seen) == 20:
            raise _EnoughError

    monkeypatch.chdir(folder)
    code = code_of_page("live_loads").replace('"suas.toml"', '"skin.toml"')
    settings = 'frame_format="cobs", smooth=True, most_contacts=1, timeout_s=10.0'
    code = code.replace('"/dev/ttyACM0", timeout_s=0.5', f'"port", {settings}')
    with Device("cobs", link=Path("port")) as device:

        def play() -> None:
            device.wait_for_host(ended.is_set)
            device.play(frames, stopped=ended.is_set)

        player = threading.Thread(target=play)
        player.start()
        try:
            with pytest.raises(_EnoughError):
                exec(compile(code, "page", "exec"), space | {"steer": steer}, space)
        finally:
            ended.set()
            player.join()
    assert next(space["frames"], None) is None
    degrees, force, error = (np.concatenate(column) for column in zip(*seen, strict=True))
    assert degrees == pytest.approx(np.full(20, np.degrees(0.2)), abs=0.5)
    chi2 = (((force - 10.0) / error) ** 2).sum()
    assert 7 < chi2 < 45  # 20 degrees of freedom
    last = space["frame"]
    assert last.loads.dtype.names == ("angle_rad", "force_N", "covariance")
    assert last.contact
    assert abs(last.filtered["angle_rad"][0] - 0.2) < 0.01
    assert last.filtered["covariance"].shape == (1, 2, 2)


def test_the_log_of_the_page(
    folder: Path, estimator: LoadEstimator, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setattr("suas_jax.runtime.settings.configure", lambda: None)
    monkeypatch.setattr("fitting.inverse_load.estimator.LoadEstimator", lambda spec: estimator)
    write_log(folder / "press.csv", np.rint(np.tile(estimator.table.rest, (3, 1))))
    code = code_of_page("readings_of").replace("suas.toml", "skin.toml")
    exec(compile(code, "page", "exec"), {})
    assert capsys.readouterr().out.count("no_contact") == 3


def test_a_control_loop_refuses_at_once(
    folder: Path, estimator: LoadEstimator, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fitting import live_loads

    def never(*arguments: object, **settings: object) -> None:
        pytest.fail("the estimator is prepared for a port that isn't there")

    monkeypatch.setattr("fitting.inverse_load.live.live_loads.skin_estimator", never)
    with pytest.raises(OSError, match="no such port"):
        live_loads(folder / "skin.toml", "/dev/ttyNOPE")
    with pytest.raises(ValueError, match="latency_s"):
        live_loads(folder / "skin.toml", "/dev/ttyNOPE", latency_s=0.0)
    with pytest.raises(ValueError, match="belong to the estimator"):
        live_loads(estimator, "/dev/ttyNOPE", most_contacts=1)
    with pytest.raises(ValueError, match="live=True"):
        live_loads(estimator, "/dev/ttyNOPE")
    with pytest.raises(ValueError, match="allowed are"):
        live_loads(folder / "skin.toml", "/dev/ttyNOPE", frame_format="morse")


def test_silence_ends_a_control_loop(estimator: LoadEstimator) -> None:
    stream: Any = _Played(itertools.repeat([]))
    settings: dict[str, Any] = {"latency_s": 0.1, "smooth": False, "timeout_s": 0.01}
    with pytest.raises(TimeoutError, match="no frame"):
        next(LiveLoads(stream, estimator, **settings))


def test_known_loads_verify_a_calibration(
    folder: Path, estimator: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    """Of a guided calibration: what agrees passes; another force, and another place, don't."""
    random = np.random.default_rng(2)
    so = readings(0.2, 8.0)[0] + 3.0  # every taxel is off by as much as at rest
    log = write_log(folder / "known.csv", np.rint(so + random.normal(0, 2, (60, TAXELS))))
    rest = Baseline(
        np.array([0]), (estimator.model_rest + 3.0)[None], np.full((1, TAXELS), 2.0), 100, {}
    )
    known = [Press(0.2, 8.0), Press(0.2, 9.5), Press(0.3, 8.0)]
    checks = verify(estimator.spec, rest, [(press, log) for press in known])
    assert [check.passed for check in checks] == [True, False, False]
    assert checks[0].force == pytest.approx(8.0, rel=0.02)
    assert checks[0].place == pytest.approx(0.2, abs=0.01)


def test_loads_as_an_array_with_what_is_not_known() -> None:
    names = ("angle", "axial", "force", "diameter")
    known = Contact(0.1, 5.0, None, np.diag([1.0, 2.0, 3.0]), axial=1e-3)
    unknown = Contact(0.2, 6.0, None, None, axial=2e-3, diameter=6e-3)
    loads = load_array([known, unknown], names)
    assert loads.dtype.names == ("angle_rad", "axial_m", "force_N", "diameter_m", "covariance")
    np.testing.assert_equal(loads["diameter_m"], [np.nan, 6e-3])
    np.testing.assert_equal(np.diag(loads["covariance"][0]), [1.0, 2.0, 3.0, np.nan])
    assert np.isnan(loads["covariance"][1]).all()
    assert load_array([], names).shape == (0,)


def test_taxels_that_never_speak_are_named(folder: Path, estimator: LoadEstimator) -> None:
    so = np.tile(np.rint(estimator.model_rest), (3, 1))
    so[:, -1] = np.nan
    log = read_log(write_log(folder / "silent.csv", so))
    (note,) = readings_of(log, estimator.spec, 2.0).notes
    assert "taxels 0.40 have no count in any frame" in note


def test_counts_that_come_in_steps_are_as_far_off_as_these(
    folder: Path, estimator: LoadEstimator
) -> None:
    """Steps of 16 were noise of 2 counts, which no load explains."""
    random = np.random.default_rng(3)
    so = (
        estimator.model_rest + random.uniform(0, 99, TAXELS) + random.normal(0, 2, (60, TAXELS))
    )
    for step in (1, 16):
        log = read_log(write_log(folder / f"steps{step}.csv", step * np.rint(so / step)))
        found = readings_of(log, estimator.spec, 2.0)
        assert found.noise == pytest.approx(np.sqrt(4 + (step**2 - 1) / 12))
        assert any("in steps of 16" in note for note in found.notes) == (step > 1)
        assert not found.stuck.any()


def test_a_stream_whose_counts_come_in_steps_is_as_far_off_as_these(
    estimator: LoadEstimator,
) -> None:
    """Live, noise stayed that of the file, and every touch a search for several contacts."""
    random = np.random.default_rng(3)
    so = (
        estimator.model_rest + random.uniform(0, 99, TAXELS) + random.normal(0, 2, (40, TAXELS))
    )
    for step in (1, 16):
        watch = StepWatch()
        assert [watch.feed(row) for row in step * np.rint(so / step)][-1] == step
    live = dataclasses.replace(estimator, live=True, rest=so.mean(0))
    weights = live.frames.weights
    live.frames.batch = lambda *_: [LoadEstimate(False)]  # type: ignore[method-assign]
    for row in 16 * np.rint(so / 16):
        live.estimate(row[None])
    assert live.step == 16
    assert live.reading_noise == pytest.approx(np.sqrt(4 + 255 / 12))
    added = live.frames.weights.variance - weights.variance
    np.testing.assert_allclose(added, 255 / 12)


def test_a_log_of_another_fluid_is_refused(folder: Path, estimator: LoadEstimator) -> None:
    file = write_log(folder / "air.csv", np.tile(np.rint(estimator.model_rest), (3, 1)))
    for fluid in ("oil", "2.2", "air"):
        log = read_log(file)
        log.header["fluid"] = fluid
        if fluid == "air":
            with pytest.raises(ValueError, match='its fluid is "air"'):
                readings_of(log, estimator.spec, 2.0)
        else:
            readings_of(log, estimator.spec, 2.0)


@pytest.mark.long
def test_posterior_agrees_with_the_covariance(
    study: ModuleType, estimator: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    so = study.measured(readings(0.35, 8.0), 6)[0]
    one = dataclasses.replace(estimator, most_contacts=1)
    (mode,) = frame_posterior(one, so, settings=Settings(steps=1500, walkers=16))
    assert_chain_agrees_with_the_mode(mode)


def test_both_places_of_an_ambiguous_frame_are_found(
    estimator: LoadEstimator, readings: Callable[..., np.ndarray]
) -> None:
    # Four taxels about the crown that read alike on both sides.
    so = readings(0.9, 2.0)
    crown = np.abs(np.linspace(-80, 80, TAXELS)) < 10
    so = np.where(crown, (so + so[:, ::-1]) / 2, np.nan)
    modes, probability = likely_modes(estimator, *estimator.weigh(so))
    assert probability[0] == pytest.approx(probability[1], rel=0.05)
    assert probability.sum() == pytest.approx(1.0)
    assert modes.parameters[0, 0] == pytest.approx(-modes.parameters[1, 0], abs=1e-3)


def write_log(path: Path, so: np.ndarray) -> Path:
    names = ",".join(f"so_{k + 1}" for k in range(so.shape[1]))
    rows = [
        f"# format: suas-so-log\n# format_version: 1\nt_host_s,t_device_s,seq,module,{names}"
    ]
    rows += [f"{0.1 * k},{0.1 * k},{k},0," + ",".join(map(str, x)) for k, x in enumerate(so)]
    path.write_text("\n".join(rows) + "\n")
    return path


def test_command_prints_one_line_a_frame(
    study: ModuleType, truth: dict[str, Any], estimator: LoadEstimator, folder: Path
) -> None:
    rest = np.tile(estimator.table.rest, (2, 1))
    so = study.measured(np.concatenate([rest, truth["single"].so[:2]]), 7).astype(int)
    log = write_log(folder / "log.csv", so)
    figure = folder / "loads.png"
    done = runner.invoke(
        app,
        [
            *("invert", str(folder / "skin.toml"), str(log), "--json", "--filter"),
            *("--contacts", "1", "--plot", str(figure)),
        ],
    )
    assert done.exit_code == 0, done.output
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line["contact"] for line in lines] == [False, False, True, True]
    assert [line["seq"] for line in lines] == [0, 1, 2, 3]
    keys = "t_s contact loads oil_pressure_Pa wall_contact chi2_per_dof latency_s status"
    assert all(set(keys.split()) <= set(line) for line in lines)
    assert lines[0]["loads"] == []
    (load,) = lines[2]["loads"]
    assert load["angle_deg"] == pytest.approx(np.rad2deg(truth["single"].loads[0, 0, 0]), abs=1)
    assert np.shape(load["covariance"]) == (2, 2)
    assert figure.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("taxels", "frames", "status"), [(30, 2, "layout_mismatch"), (TAXELS, 0, "empty_log")]
)
def test_unusable_logs_exit_with_a_status(
    folder: Path, estimator: LoadEstimator, taxels: int, frames: int, status: str
) -> None:
    log = write_log(folder / "bad.csv", np.full((frames, taxels), 160))
    done = runner.invoke(app, ["invert", str(folder / "skin.toml"), str(log), "--json"])
    assert done.exit_code == 2
    assert json.loads(done.stdout)["status"] == status
    assert "bad.csv" in done.stderr
