"""Designs: what is wanted, the search on problems with a known answer, and skin files."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from fitting.datasheet.readings import far_taxels
from fitting.datasheet.sheet import Figure
from fitting.datasheet.variants import STEP
from fitting.design import design, section
from fitting.design.design import Design, _changed, designed_skin
from fitting.design.front import FrontPoint, front, undominated
from fitting.design.problem import Outcome, off_the_wall
from fitting.design.problem import Problem as DesignProblem
from fitting.design.resume import KeptSearches
from fitting.design.search import (
    Found,
    Price,
    Trial,
    _EndedError,
    _Program,
    best_first,
    search,
    worst,
)
from fitting.design.section import SectionProblem, bound_of_units
from fitting.design.want import Front, Limit, OwnLimit, Variable, Want, load_want
from fitting.report.description import ReportTable
from fitting.workers import LocalWorkers
from suas_jax import skin_of
from suas_jax.config import (
    AlongSpec,
    ConfigError,
    UncertainQuantity,
    continuous_inputs,
    load_skin,
)
from suas_jax.config.fields import quantity_of
from suas_jax.config.tolerance import deviation_of
from suas_jax.runtime.compiled import require_float64

ROOT = Path(__file__).parent.parent
WANT = ROOT / "configs" / "design" / "sensitive.toml"


def is_refused(want: Path, folder: Path, old: str, new: str, words: str) -> None:
    """A file of what is wanted is refused with some words, once a part of it is another one."""
    text = want.read_text().replace("../skins", str(ROOT / "configs" / "skins"))
    assert old in text
    file = folder / "want.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=words):
        load_want(file)


class _Want(Want):
    start = np.array([0.1, 0.2])


class Problem:
    """Two variables; figures (x - 0.8)^2 + (y - 0.6)^2 + 1 + k and x + y at two places."""

    tolerance = 1e-7

    def __init__(self, starts: int = 3) -> None:
        variables = tuple(Variable(name, (name,), 0.0, 1.0, False) for name in "xy")
        none: Any = None
        self.asked: list[Any] = []
        limits = (Limit("range_N", 1.0, False),)
        goal = "force_resolution_N"
        self.want: Any = _Want(
            none, none, variables, goal, False, limits, None, 2, None, starts, 1
        )

    def __call__(self, x: Any) -> Outcome:
        """Figures and slopes."""
        self.asked.append(x)
        centre = np.array([0.8, 0.6])
        goal = np.sum((x - centre) ** 2) + 1 + np.arange(2.0)
        return Outcome(
            {"force_resolution_N": goal, "range_N": np.full(2, x.sum())},
            {
                "force_resolution_N": np.tile(2 * (x - centre), (2, 1)),
                "range_N": np.ones((2, 2)),
            },
            True,
        )


def test_search_finds_the_optimum_on_its_limit_and_its_price() -> None:
    found = search(Problem())  # type: ignore[arg-type]
    np.testing.assert_allclose(found.x, [0.6, 0.4], atol=1e-5)  # nearest of x + y <= 1
    assert found.goal == pytest.approx(2.08)  # the worst of both places
    assert found.agreeing == 3
    # The limit moved by 1 % moves the goal by 0.4 * 0.01: of 2.08, 0.192 %.
    assert sum(price.price for price in found.prices) == pytest.approx(0.4 / 2.08, rel=1e-3)
    assert {price.name for price in found.prices} == {"range_N"}


def test_search_says_where_no_design_keeps_the_limits() -> None:
    problem = Problem()
    problem.want = dataclasses.replace(problem.want, limits=(Limit("range_N", 3.0, True),))
    nearest = "the range is 2 N in the design that comes nearest, at least 3 N is asked for"
    with pytest.raises(ValueError, match=f"keeps the limits from any start: {nearest}; widen"):
        search(problem)  # type: ignore[arg-type]


class _Held(Problem):
    """The same, held by a limit of the search itself on 2 - x - y."""

    def __call__(self, x: Any) -> Outcome:
        """Figures and slopes."""
        found = super().__call__(x)
        found.values["min_gap_m"] = 2 - found.values["range_N"]
        found.slopes["min_gap_m"] = -found.slopes["range_N"]
        return found


def test_a_limit_of_the_search_itself_is_told_as_one() -> None:
    problem = _Held()
    problem.want = dataclasses.replace(problem.want, limits=(OwnLimit("min_gap_m", 1.0, True),))
    found = search(problem)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.x, [0.6, 0.4], atol=1e-5)
    after: Any = SimpleNamespace(
        measured=SimpleNamespace(arc=np.arange(3), grid=(3, 1), coordinates={})
    )
    made = Design(problem, found, after, after, [], 0)  # type: ignore[arg-type]
    assert "itself: it keeps the membrane off the wall" in made._price(found.prices[0])
    assert "search" not in made._price(found.prices[0]._replace(purpose=""))
    problem.want = dataclasses.replace(problem.want, limits=(OwnLimit("min_gap_m", 3.0, True),))
    with pytest.raises(
        ValueError, match="at least 3000 mm is needed, which keeps the membrane"
    ):
        search(problem)  # type: ignore[arg-type]


class _Cliff(Problem):
    """The same without states beyond x = 0.5, of which no figure tells beforehand."""

    def __call__(self, x: Any) -> Outcome:
        """Figures and slopes."""
        return super().__call__(x)._replace(found=bool(x[0] < 0.5))


def test_search_ends_with_a_design_where_states_are_lost() -> None:
    problem = _Cliff(8)
    found = search(problem)  # type: ignore[arg-type]
    assert any(t.start[0] > 0.5 for t in found.trials)  # a start without a state
    for trial in found.trials:
        assert trial.x[0] < 0.5
        assert trial.x.sum() < 1 + 1e-4
        assert trial.goal < worst(problem.want, trial.first) + 1e-9
        assert trial.calls < 50
    assert found.goal < 2.1 + 1e-2  # of the best design, x = y = 0.5


def test_a_start_without_a_state_retreats_halfway_to_the_file_s_design() -> None:
    problem = _Cliff()
    trial = best_first(problem, problem.want, [np.array([0.9, 0.4])])[0]  # type: ignore[arg-type]
    retreats = [[0.9, 0.4], [0.5, 0.3], [0.3, 0.25]]  # halves of the way to (0.1, 0.2)
    np.testing.assert_allclose(problem.asked[:3], retreats)
    np.testing.assert_array_equal(trial.start, [0.9, 0.4])
    assert trial.first.values["range_N"][0] == pytest.approx(0.55)

    class Alone(Problem):
        def __call__(self, x: Any) -> Outcome:
            return super().__call__(x)._replace(found=np.allclose(x, retreats[-1]))

    problem = Alone()
    trial = best_first(problem, problem.want, [np.array([0.9, 0.4])])[0]  # type: ignore[arg-type]
    # The search from there has all of its patience, whatever the way there took.
    lost = [x for x in problem.asked[3:] if not np.allclose(x, retreats[-1])]
    assert len(lost) == 12
    assert trial.message.startswith("was ended beside 12 designs")


def test_a_design_without_a_state_breaks_all_limits_by_more_than_the_last_one() -> None:
    program = _Program(_Cliff(), _Cliff().want)  # type: ignore[arg-type]
    (known, rows), (lost, same) = (
        program._constraints(np.array([x, 0.3, 2.0])) for x in (0.4, 0.6)
    )
    np.testing.assert_allclose(lost, known - 1)
    np.testing.assert_array_equal(rows, same)
    # t less the goal at both places, and 1 - (x + y).
    np.testing.assert_allclose(known, [2 - 1.25, 2 - 2.25, 0.3, 0.3])


def test_starts_agree_whose_goals_differ_by_less_than_a_fifth_of_a_percent() -> None:
    problem = Problem()
    whole = search(problem)  # type: ignore[arg-type]
    trials = [whole.trials[0]._replace(start=problem.want.start)] * 3
    goals = [trials[0].goal * (1 + by) for by in (0.0, 0.0019, 0.0021)]
    with pytest.MonkeyPatch.context() as patch:
        made = [t._replace(goal=goal) for t, goal in zip(trials, goals, strict=True)]
        patch.setattr("fitting.design.search.best_first", lambda *given: made)
        assert search(problem).agreeing == 2  # type: ignore[arg-type]


def _unlimited(problem: Problem, **changes: Any) -> Problem:
    problem.want = dataclasses.replace(problem.want, limits=(), **changes)
    return problem


class _Lower(Problem):
    """The same less 10: the goal is below zero everywhere."""

    def __call__(self, x: Any) -> Outcome:
        """Figures and slopes."""
        found = super().__call__(x)
        goal = found.values["force_resolution_N"] - 10
        return found._replace(values=found.values | {"force_resolution_N": goal})


def test_goals_below_zero_have_their_optimum_and_price() -> None:
    problem = _Lower()
    found = search(problem)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.x, [0.6, 0.4], atol=1e-4)
    assert found.goal == pytest.approx(-7.92, abs=1e-6)
    assert sum(price.price for price in found.prices) == pytest.approx(0.4 / 7.92, rel=1e-3)


def test_a_limit_that_hardly_holds_the_design_has_its_small_price() -> None:
    problem = Problem()
    problem.want = dataclasses.replace(problem.want, limits=(Limit("range_N", 1.38, False),))
    found = search(problem)  # type: ignore[arg-type]
    # (1.4 - 1.38) N a newton of the limit, which is 1.38 N.
    expected = 0.02 * 1.38 / 2
    assert sum(price.price for price in found.prices) == pytest.approx(expected, rel=0.02)


def test_a_bound_of_what_does_nothing_is_not_told() -> None:
    """Of two variables, the second one at its bound, whose slopes are zero."""

    class Idle(Problem):
        def __call__(self, x: Any) -> Outcome:
            found = super().__call__(np.array([x[0], 0.6]))
            return found._replace(slopes={k: v * [1.0, 0.0] for k, v in found.slopes.items()})

    problem = _unlimited(Idle(1))
    problem.want.start = np.zeros(2)
    found = search(problem)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.x, [0.8, 0.0], atol=1e-4)
    assert not found.prices


def test_a_search_ends_after_thirty_designs_a_variable_and_one_more() -> None:
    program = _Program(Problem(), Problem().want)  # type: ignore[arg-type]
    for k in range(90):
        program._outcome(np.array([0.01 * k, 0.5]))
    with pytest.raises(_EndedError, match="after 90 designs"):
        program._outcome(np.zeros(2))


def test_a_goal_to_be_large_ends_at_the_bounds_with_their_prices() -> None:
    """Of x + y, which is at most 2: each bound is worth half of the goal."""

    class Larger(Problem):
        def __call__(self, x: Any) -> Outcome:
            found = super().__call__(x)  # and larger by one at the second place
            return found._replace(values=found.values | {"range_N": x.sum() + np.arange(2.0)})

    want = {"goal": "range_N", "maximise": True}
    problem: Any = _unlimited(Larger(), **want)
    program = _Program(problem, problem.want)
    for x in (0.2, 0.9, 0.5):
        program._outcome(np.array([x, x]))
    assert program._best is not None
    assert program._best[0] == pytest.approx(1.8)  # of a search that ends here
    found = search(problem)
    np.testing.assert_allclose(found.x, [1.0, 1.0], atol=1e-6)
    assert found.goal == pytest.approx(2.0)
    assert found.before == pytest.approx(0.3)
    assert [(p.name, p.least, p.value, p.place) for p in found.prices] == [
        ("x", False, 1.0, None),
        ("y", False, 1.0, None),
    ]
    assert [p.price for p in found.prices] == pytest.approx([0.5, 0.5], rel=1e-6)


def test_searches_of_workers_are_those_of_this_process() -> None:
    with ThreadPoolExecutor(2) as workers:
        by_workers = search(Problem(), workers=workers)  # type: ignore[arg-type]
    alone = search(Problem())  # type: ignore[arg-type]
    assert by_workers.calls == alone.calls > 3
    for found, expected in zip(by_workers.trials, alone.trials, strict=True):
        np.testing.assert_array_equal(found.x, expected.x)


class _OfFloat64(Problem):
    """The same, of arrays that a process without float64 would cut down."""

    def __init__(self) -> None:
        super().__init__(starts=1)
        self.one = jnp.ones(1)

    def __call__(self, x: Any) -> Outcome:
        """Figures and slopes."""
        require_float64()
        assert self.one.dtype == np.float64
        return super().__call__(x)


def test_processes_search_in_float64() -> None:
    with LocalWorkers(1) as workers:
        found = search(_OfFloat64(), workers=workers)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.x, [0.6, 0.4], atol=1e-5)


class _StopError(Exception):
    """What ends a program from outside."""


class _Stopped(Problem):
    def __call__(self, x: Any) -> Outcome:
        """Figures, of the first designs."""
        if len(self.asked) > 12:
            raise _StopError
        return super().__call__(x)


def test_a_design_goes_on_from_the_searches_that_ended(tmp_path: Path) -> None:
    file, skin = tmp_path / "searches.json", load_skin(ROOT / "configs" / "skins" / "suas.toml")

    def searched(problem: Problem, *, again: bool = True) -> Found:
        problem.want = dataclasses.replace(problem.want, spec=skin)
        return search(problem, kept=KeptSearches(file) if again else None)  # type: ignore[arg-type]

    whole, rest, nothing = Problem(5), Problem(5), Problem(5)
    expected = searched(whole, again=False)
    with pytest.raises(_StopError):
        searched(_Stopped(5))
    found = searched(rest)
    assert 0 < len(rest.asked) < len(whole.asked)
    np.testing.assert_array_equal(found.x, expected.x)
    assert (found.prices, found.calls) == (expected.prices, expected.calls)
    searched(nothing)
    assert not nothing.asked
    # A search that found nothing is kept, too.
    lost = Outcome({"a": np.array([np.inf])}, {"a": np.array([[np.nan]])}, False)
    start, empty = np.array([0.3, 0.4]), np.zeros(0)
    KeptSearches(file).add(rest.want, Trial(start, start, np.inf, "lost", empty, lost, lost, 1))
    known = KeptSearches(file).known(rest.want, start)
    assert known is not None
    assert known.goal == np.inf
    np.testing.assert_array_equal(known.last.slopes["a"], lost.slopes["a"])
    # Another goal has searches of its own.
    other = dataclasses.replace(rest.want, maximise=True)
    own, anothers = KeptSearches(file), KeptSearches(file)
    assert own.known(rest.want, rest.want.start) is not None
    assert anothers.known(other, rest.want.start) is None
    assert (own.note, KeptSearches(tmp_path / "none.json").note) == ("", "")
    assert "of another design" in anothers.note
    # Units of another tolerance are others, though no number differs; so are those of a table.
    thickness = UncertainQuantity(skin.geometry.thickness, 1e-3)
    table = AlongSpec(arc=(0.0, 1.0), value=(1.5e-3, 1.5e-3))
    for given in (thickness, table):
        geometry = skin.geometry.model_copy(update={"thickness": given})
        moved = dataclasses.replace(
            rest.want, spec=skin.model_copy(update={"geometry": geometry})
        )
        assert KeptSearches(file).known(moved, rest.want.start) is None
    file.write_text('{"searches": {"a": 1}}')
    with pytest.raises(ValueError, match="does not hold searches"):
        KeptSearches(file)


def test_front_between_two_goals_is_the_closed_form() -> None:
    problem = Problem()
    problem.want = dataclasses.replace(problem.want, limits=(), front=Front("range_N", 4))
    asked = problem.asked = []
    found = search(problem)  # type: ignore[arg-type]
    points, calls = front(problem, found)  # type: ignore[arg-type]
    assert found.calls + calls == len(asked)
    # From the goal's optimum, where x + y is 1.4, to (1, 1). Between them the nearest point to
    # (0.8, 0.6) on x + y = v, and on x = 1 where it would lie beyond.
    v = np.array([1.4, 1.6, 1.8, 2.0 * (1 - 1e-3)])
    x = np.minimum(0.8 + (v - 1.4) / 2, 1.0)
    np.testing.assert_allclose([p.other for p in points], v, rtol=1e-5)
    np.testing.assert_allclose([p.x for p in points], np.stack([x, v - x], 1), atol=1e-4)
    goal = 2 + (x - 0.8) ** 2 + (v - x - 0.6) ** 2
    np.testing.assert_allclose([p.goal for p in points], goal, rtol=1e-5)


@pytest.mark.parametrize("maximise", [False, True])
def test_no_design_of_a_front_is_worse_by_both_figures(maximise: bool) -> None:
    goals = np.array([1.0, 1.6, 1.2, 1.3, 1.9])  # the second search stopped short
    goals = 1 / goals if maximise else goals
    points = [FrontPoint(np.zeros(1), goal, float(k)) for k, goal in enumerate(goals)]
    kept = undominated(points, maximise=maximise)
    assert [point.other for point in kept] == [0.0, 2.0, 3.0, 4.0]


@pytest.mark.long  # derivatives of a mounted skin; its limit's place is in the tests below
def test_a_design_knows_how_near_buckling_its_skin_is(tmp_path: Path) -> None:
    skin = (ROOT / "configs" / "skins" / "suas.toml").read_text()
    filled = skin.replace('model = "incompressible"', 'model = "incompressible"\nfill = 1.0')
    (tmp_path / "skin.toml").write_text(filled)
    text = WANT.read_text().replace("../skins/suas.toml", "skin.toml")
    text = text.replace("geometry.oil_gap ", "oil.fill ")
    (tmp_path / "want.toml").write_text(text.replace('["2 mm", "8 mm"]', "[0.98, 1.02]"))
    problem = SectionProblem(load_want(tmp_path / "want.toml"))
    assert problem.want.limits[-1].key == "buckling_share"

    def stands(fill: float) -> Outcome:
        return problem._buckling_share(np.array([0.3, fill, 0.5]))

    at_fit, near, other = stands(0.5), stands(0.4), stands(0.41)
    assert at_fit.values["buckling_share"][0] == pytest.approx(0, abs=1e-9)
    share, slope = near.values["buckling_share"][0], near.slopes["buckling_share"][0]
    assert 0.3 < share < 0.95
    change = other.values["buckling_share"][0] - share
    assert slope[1] == pytest.approx(change / 0.01, rel=0.1)
    assert abs(slope[2]) < 1e-6  # a stiffer skin buckles by the same filling
    # Less oil buckles the skin where the share becomes one.
    low, high = 0.2, 0.4
    assert not stands(low).found
    for _ in range(16):
        middle = (low + high) / 2
        low, high = (low, middle) if stands(middle).found else (middle, high)
    assert stands(high).values["buckling_share"][0] == pytest.approx(1, abs=1e-2)


@pytest.mark.parametrize(("key", "side"), [("range_N", -1), ("force_resolution_N", 1)])
def test_bound_of_units_is_the_quantile_of_a_lognormal_figure(key: str, side: int) -> None:
    slopes, own = np.array([0.3, -0.4]), np.array([2.0, 5.0])  # of the logarithm, by tolerances
    moves = STEP * np.array([0.0, -slopes[0], slopes[0], -slopes[1], slopes[1]])
    values = np.exp(moves)[:, None] * own
    found = bound_of_units(key, values, 1.5)
    np.testing.assert_allclose(found, own * np.exp(side * 1.5 * 0.5), rtol=1e-4)
    np.testing.assert_array_equal(bound_of_units(key, values[:1], 1.5), own)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("force  =", 'units = "100 %"\nforce  =', "between 0.5 and 1"),
        ("[limits]", '[front]\nfigure = "force_resolution_N"\n[limits]', "the goal itself"),
        ("[limits]", '[front]\nfigure = "range"\n[limits]', "range_N"),
        ("[limits]", '[front]\nfigure = "range_N"\npoints = 2\n[limits]', "at least 3"),
        ("geometry.thickness", "geometry.thicknes", 'did you mean "geometry.thickness"'),
        ('"0.8 mm", "3 mm"', '"0.8 mm"', "two values"),
        ('"0.8 mm"', '"0.8 N"', "a length with its unit is expected"),
        ('"0.8 mm", "3 mm"', "0.8e-3, 3e-3", "= 0.0008: the unit is missing"),
        ('["-60 deg", "60 deg"]', "[-60, 60]", "the unit is missing; an angle"),
        ("factor = [0.25", 'factor = ["2 mm"', "a number without a unit is expected"),
        ('"0.8 mm"', '"-1 mm"', "must be greater than zero"),
        ('"0.8 mm"', '"0.8 mm +- 0.1 mm"', "a bound has no deviation"),
        ("geometry.thickness = [", "electrodes.noise = [1, 3] #", "the less the better"),
        ("minimise", "optimise", "minimise or maximise"),
        ('"force_resolution_N"', '"force_resolution"', 'did you mean "force_resolution_N"'),
        ("range_N ", "rang_N", "unknown figure"),
        ('"30 N"', "30", "the unit is missing"),
        ("[search]", "[serch]", 'did you mean "search"'),
        ('["-60 deg", "60 deg"]', '["60 deg", "-60 deg"]', "left of the second"),
        ('["-60 deg", "60 deg"]', '["-95 deg", "60 deg"]', "clamped edges at -90 deg"),
        ("places = 9", "places = 2", "at least 3"),
        ('"3 mm"', '"60 mm"', r'thickness = "60 mm": must be less than inner_radius'),
        ("factor = [0.25", "factor = [-0.25", "must be greater than zero, but C1 is"),
        ('"material.C2",', '"material.C1",', r'"material\.C1": is named twice'),
        ('of = ["material.C1", "material.C2", "material.C3"]', "of = []", "at least one"),
        ('{ at_least = "30 N" }', "{}", "at_least or at_most is needed"),
        ('"30 N" }', '"30 N", at_most = "2e-3 kN" }', "at_least must be below at_most"),
        ('range_N   = { at_least = "30 N"', "crosstalk = { at_most = 5", '"5 %", or "500 %"'),
        ('range_N   = { at_least = "30 N"', "crosstalk = { at_most = true", "a number"),
        ("places = 9", "places = 100000", "1000 at most"),
        ("[limits]", "[[limits]]", r"a table is expected: \[limits\]"),
        ("starts = 3", "starts = 3\nseed = -1", "seed = -1"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    is_refused(WANT, tmp_path, old, new, words)


@pytest.mark.parametrize(
    ("figure", "bound", "value"),
    [
        ("lowest_frequency_Hz", '"20 Hz"', 20.0),
        ("sensitivity_counts_per_N", '"15 counts/N"', 15.0),
        ("crosstalk", "0.4", 0.4),
        ("crosstalk", '"120 %"', 1.2),
    ],
)
def test_limits_have_the_units_of_data_sheets(
    tmp_path: Path, figure: str, bound: str, value: float
) -> None:
    text = WANT.read_text().replace("../skins", str(ROOT / "configs" / "skins"))
    file = tmp_path / "want.toml"
    file.write_text(text.replace("[limits]", f"[limits]\n{figure} = {{ at_most = {bound} }}"))
    assert load_want(file).limits[0] == Limit(figure, value, least=False)


def test_factors_may_be_shares(tmp_path: Path) -> None:
    text = WANT.read_text().replace("../skins", str(ROOT / "configs" / "skins"))
    file = tmp_path / "want.toml"
    file.write_text(text.replace("[0.25, 2]", '["25 %", 2]'))
    assert load_want(file).variables == load_want(WANT).variables


def test_units_are_refused_beside_figures_whose_tolerance_is_unknown(tmp_path: Path) -> None:
    text = WANT.read_text().replace("../skins", str(ROOT / "configs" / "skins"))
    text = text.replace("[limits]", "[limits]\nbandwidth_Hz = { at_least = 5 }")
    file = tmp_path / "want.toml"
    file.write_text(text.replace("[at]", '[at]\nunits = "90 %"'))
    with pytest.raises(ConfigError, match=r"at\.units.*limits\.bandwidth_Hz"):
        load_want(file)


def test_designed_file_has_the_numbers_and_keeps_the_rest(tmp_path: Path) -> None:
    want, output = load_want(WANT), tmp_path / "designed.toml"
    x = np.array([0.25, 0.5, 0.75])
    output.write_text(designed_skin(want, x, output))
    found = continuous_inputs(load_skin(output))
    before = continuous_inputs(want.spec)
    wanted = want.inputs(x)
    assert found["geometry.thickness"] == pytest.approx(1.35e-3)
    for path, value in {**before, **wanted}.items():
        assert found[path] == pytest.approx(float(value), rel=1e-8)
    assert "# from the symmetry axis to an edge" in output.read_text()


@pytest.mark.parametrize(
    ("text", "value", "wanted"),
    [
        ("1.50 mm +- 0.03 mm", 3e-3, "3 mm +- 0.06 mm"),
        ("(1.50 +- 0.03) mm", 3e-3, "(3 +- 0.06) mm"),
        ("1.50 mm +- 2 %", 3e-3, "3 mm +- 2 %"),
        ("0.05 % ± 0.02 %", -1e-3, "-0.1 % ± 0.04 %"),
        ("0 %", -1e-3, "-0.1 %"),
        ("20 degC +- 5 K", 303.15, "303.15 K +- 5 K"),
        ("0 mm", 2e-3, "2 mm"),
        (2.2, 2.5, 2.5),
    ],
)
def test_designed_quantities_keep_their_unit_and_share(
    text: Any, value: float, wanted: Any
) -> None:
    dimension: Any = "length" if "mm" in str(text) else "temperature"
    dimension = "number" if "%" in str(text)[:6] or text == 2.2 else dimension
    now = float(quantity_of(text, dimension))
    assert _changed(text, now, value) == wanted
    assert float(quantity_of(wanted, dimension)) == pytest.approx(value, rel=1e-9)


def test_designs_have_the_tolerances_of_their_files(tmp_path: Path) -> None:
    skin = ROOT / "configs" / "skins" / "suas.toml"
    own = tmp_path / "skin.toml"
    own.write_text(skin.read_text().replace('"1.5 mm"', '"1.5 mm +- 0.06 mm"', 1))
    text = WANT.read_text().replace("../skins/suas.toml", str(own))
    (tmp_path / "want.toml").write_text(text)
    want, output = load_want(tmp_path / "want.toml"), tmp_path / "designed.toml"
    x = np.array([0.9, 0.5, 0.5])
    output.write_text(designed_skin(want, x, output))
    problem: Any = SimpleNamespace(want=want)
    for spec in (load_skin(output), DesignProblem.spec(problem, x)):
        assert spec.geometry.thickness == pytest.approx(2.78e-3)
        assert deviation_of(spec.geometry.thickness) == pytest.approx(0.04 * 2.78e-3)


def test_a_limit_is_told_at_its_place_of_the_data_sheet() -> None:
    """A sheet has the places of the search and those between them, along arc and axis."""
    along, axially = np.linspace(-40, 40, 5), np.linspace(-30, 30, 3)
    angle, axial = (x.ravel() for x in np.meshgrid(along, axially, indexing="ij"))
    coordinates = {"angle_deg": angle, "axial_mm": axial}
    after = SimpleNamespace(
        measured=SimpleNamespace(arc=angle, grid=(5, 3), coordinates=coordinates)
    )
    none: Any = None
    made = Design(none, none, none, after, [], 0)  # type: ignore[arg-type]
    searched = [(a, x) for a in (-40, 0, 40) for x in (-30, 30)]
    for k, (a, x) in enumerate(searched):
        price = Price("range_N", True, 30.0, k, 0.1)
        assert made._place(price) == {"angle_deg": a, "axial_mm": x}
    assert made._place(Price("geometry.thickness", True, 1e-3, None, 0.1)) == {}
    assert made._place(Price("buckling_share", False, 0.5, 0, 0.1)) == {}


def test_a_limit_that_is_not_kept_between_the_places_of_the_search_is_told() -> None:
    limits = Limit("range_N", 30.0, True), Limit("force_resolution_N", 0.1, False)
    want: Any = SimpleNamespace(limits=limits, places=5)
    coordinates = {"angle_deg": np.array([0.0, 10.0]), "arc_m": np.array([0.0, 0.0125])}

    def made(force_range: float, resolution: float) -> Design:
        figures = (
            Figure("range_N", force_range, place=1),
            Figure("force_resolution_N", resolution, place=0),
        )
        after: Any = SimpleNamespace(
            figures=figures, measured=SimpleNamespace(coordinates=coordinates)
        )
        none: Any = None
        return Design(SimpleNamespace(want=want), none, none, after, [], 0)  # type: ignore[arg-type]

    assert made(29.98, 0.1).missed == []
    assert [limit.key for limit, _ in made(40.0, 0.11).missed] == ["force_resolution_N"]
    ((limit, figure),) = made(29.1, 0.05).missed
    told = made(29.1, 0.05)._miss(limit, figure)
    assert "Range at 12 mm is 29.1 N, not at least 30 N" in told


def test_a_goal_that_is_worse_between_the_places_of_the_search_is_told() -> None:
    measured = SimpleNamespace(
        arc=np.arange(3), grid=(3, 1), coordinates={"angle_deg": np.array([0.0, 9.0, 18.0])}
    )
    want: Any = SimpleNamespace(goal="force_resolution_N", maximise=False, places=2)
    found: Any = SimpleNamespace(goal=0.01)

    def told(value: float, place: int) -> list[str]:
        figures = (Figure("force_resolution_N", value, place=place),)
        after: Any = SimpleNamespace(figures=figures, measured=measured)
        made = Design(SimpleNamespace(want=want), found, after, after, [], 0)  # type: ignore[arg-type]
        return [made._miss(*pair) for pair in made._goal_between()]

    (text,) = told(0.015, 1)
    assert "Force resolution at 9 deg is 0.015 N, not at most 0.01 N" in text
    assert told(0.0101, 1) == told(0.015, 2) == []


def test_designs_between_two_goals_are_told_in_the_units_of_each() -> None:
    """Newtons and millimetres, as data sheets tell them; then the inputs."""
    goal, other = "force_resolution_N", "place_resolution_m"
    want: Any = SimpleNamespace(
        goal=goal, against=(other,), inputs=lambda x: {"geometry.thickness": x[0]}
    )
    found: Any = SimpleNamespace(x=np.array([1e-3]))
    points = [
        FrontPoint(np.array([1e-3]), 0.05, 2e-3),
        FrontPoint(np.array([2e-3]), 0.02, 3e-3),
    ]
    none: Any = None
    made = Design(SimpleNamespace(want=want), found, none, none, points, 0)  # type: ignore[arg-type]
    table, _ = made._front()
    assert isinstance(table, ReportTable)
    rows = [tuple(map(float, row)) for row in table.rows]
    np.testing.assert_allclose(rows, [(0.05, 2.0, 1e-3), (0.02, 3.0, 2e-3)])


def test_data_sheets_of_a_design_have_the_places_between_those_of_the_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []
    found: Any = SimpleNamespace(x=np.zeros(1), calls=7)
    ends = np.zeros(1), np.ones(1)
    problem = SimpleNamespace(grid=(9, 3), rated=3.0, ends=ends, spec=lambda x: "design")
    want: Any = SimpleNamespace(spec="file", front=None)
    monkeypatch.setattr(design, "problem_of", lambda *given: problem)
    monkeypatch.setattr(design, "search", lambda *given: found)
    monkeypatch.setattr(
        design, "data_sheet", lambda *given, **more: asked.append((*given[:4], more["between"]))
    )
    assert design.design_skin(want).calls == 7
    assert asked == [(spec, (17, 5), None, 3.0, ends) for spec in ("file", "design")]


def test_a_design_keeps_the_membrane_off_the_wall() -> None:
    """Where a figure is read under the rated force and no limit of the file holds it there."""
    want = load_want(WANT)
    limited = dataclasses.replace(want, limits=(Limit("min_gap_m", 1e-4, True),))
    assert off_the_wall(dataclasses.replace(want, limits=())) == limited  # 2 % of 5 mm
    for limit, force in (("min_gap_m", 10.0), ("range_N", 30.0)):
        own = dataclasses.replace(want, limits=(Limit(limit, 30.0, True),), force=force)
        assert off_the_wall(own) is own
    short = dataclasses.replace(want, limits=(Limit("range_N", 9.0, True),), force=10.0)
    assert [limit.key for limit in off_the_wall(short).limits] == ["range_N", "min_gap_m"]
    light = dataclasses.replace(want, goal="sensitivity_counts_per_N", limits=())
    assert off_the_wall(light) is light


def test_crosstalk_is_that_of_taxels_that_are_far_on_the_design(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gap = (Variable("gap", ("geometry.oil_gap",), 2e-3, 24e-3, False),)
    skin = ROOT / "configs" / "skins" / "suas.toml"
    want = Want(skin, load_skin(skin), gap, "crosstalk", False, (), None, 5, 10.0, 1, 0)
    problem, seen = SectionProblem(want), list[Any]()
    monkeypatch.setattr(problem, "first_contacts", lambda x: np.ones(5))

    def run(program: Any, asked: Any, x: Any, touch: Any, numbers: Any) -> Any:
        seen.append(numbers.far)
        values = np.where(numbers.far.any(0), 0.5, np.nan)  # as `figures_at` has them
        return np.zeros((2, 5, 1)), (np.stack([np.ones(5), values]), np.zeros((1, 4, 5)))

    monkeypatch.setattr(section, "COMPILED", SimpleNamespace(run=run))
    for x in (0.0, 1.0):
        found = problem(np.array([x]))
        assert found.found
        np.testing.assert_array_equal(found.values["crosstalk"] > 0, seen[-1].any(0))
        own = skin_of(problem.spec(np.array([x])), contact=False)
        np.testing.assert_array_equal(seen[-1], far_taxels(own, problem.angle[:, None]))
    assert seen[1].sum() < seen[0].sum()
    assert not seen[1].any(0).all()  # a contact that no taxel is far from disturbs none


def test_figures_without_a_place_have_central_differences() -> None:
    """Exact of squares; a figure that is not known at the design makes it one without."""
    square = np.array([[1.0, 2.0], [3.0, -1.0]])
    problem: Any = SimpleNamespace(
        _others=("bandwidth_Hz", "quality"), _without_place=lambda x: x**2 @ square + x @ square
    )
    x, known = np.array([0.3, 0.7]), Outcome({"range_N": np.ones(3)}, {}, True)
    found = DesignProblem._with_others(problem, known, x)
    assert found.found
    assert set(found.values) == {"range_N", "bandwidth_Hz", "quality"}
    slopes = np.concatenate([found.slopes[key] for key in problem._others])
    np.testing.assert_allclose(slopes, ((2 * x + 1)[:, None] * square).T)
    problem._without_place = lambda x: np.array([np.nan, 1.0])
    assert not DesignProblem._with_others(problem, known, x).found


def test_a_tolerance_of_what_is_zero_in_the_file_stays_as_it_is() -> None:
    skin = load_skin(ROOT / "configs" / "skins" / "suas.toml")
    geometry = skin.geometry.model_copy(update={"mounting": UncertainQuantity(0.0, 5e-4)})
    skin = skin.model_copy(update={"geometry": geometry})
    want = SimpleNamespace(spec=skin, inputs=lambda x: {"geometry.mounting": -1e-3})
    problem: Any = SimpleNamespace(want=want)
    found = DesignProblem.spec(problem, np.zeros(1)).geometry.mounting
    assert (float(found), deviation_of(found)) == (-1e-3, 5e-4)
