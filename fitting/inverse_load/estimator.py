"""Inverse load estimation: where contacts are, how strong, and how sure, from readings.

::

    readings -> as the model has them, weighed              `drift`
             -> taxels that stand alone left out            `lone_taxels`
             -> contact or not                              `detection`
             -> nearest states of a table                   `table`, `search`
             -> least squares with exact derivatives        `model`, `explanation`
             -> number of contacts, faulty taxels           `pairs`, `selection`
             -> the same, less what presses showed          `discrepancy`
             -> covariances, statuses                       `systematic`, `assessment`
             -> what may be motion of the film              `film_motion`, `taps`
             -> dents that a load before has left           `fading`

`frames` goes this way for frames by themselves; what frames before say of them is followed
here. Readings are compared with the skin's own model in counts, weighed by their variances
(`ReadingWeights`): the corrected shell is within `MODEL_ERROR` of the continuum, in terms of
the change from rest. What the skin file's own numbers leave open
(`suas_jax.config.input_errors`) is the same in all frames.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.drift import (
    ROUNDING,
    Drift,
    DriftFollower,
    PastOfFrames,
    ReadingWeights,
    zero_of_readings,
)
from fitting.inverse_load.estimate.estimate import STATUS, Contact, LoadEstimate
from fitting.inverse_load.estimate.parts import EstimationParts
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.fading import FadingWatch
from fitting.inverse_load.film_motion import FilmFollower, FilmMotion, fading_time
from fitting.inverse_load.fit.bounded_selection import BoundedSelection
from fitting.inverse_load.fit.load_posterior import AbstractLoadPosterior
from fitting.inverse_load.fit.lone_taxels import LoneTaxels
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.frames import FULL_SCALE, FrameEstimator
from fitting.inverse_load.memory.series import LoadMemory
from fitting.inverse_load.readings import StepWatch, noise_in_steps, noise_of_readings
from fitting.inverse_load.settings import EstimatorSettings
from fitting.inverse_load.taps import MotionWatch, TapFinder
from fitting.steps import Budget
from suas_jax.config import InputErrors, input_errors
from suas_jax.config.input_errors import as_assembled

if TYPE_CHECKING:
    from fitting.inverse_load.field.fallback import FieldFallback
    from fitting.inverse_load.memory.series import AbstractMemoryFollower
    from suas_jax.scene.skin import Skin

__all__ = ["FULL_SCALE", "STATUS", "Contact", "LoadEstimate", "LoadEstimator"]

_GATHERED_ON_PADS = 32  # frames of a stream between looks at the drift of hundreds of taxels
_BLOCK = 2048  # frames whose explanations are sought together


@dataclass
class LoadEstimator(EstimatorSettings):
    """Estimates loads on one skin; made once, used for any number of frames.

    Args:
        spec: the skin.
        direction: expect nothing of the contacts' directions; else they are near radial.
        false_alarm: rate at which noise alone may be called a contact.
        noise: standard deviation of a reading [counts]; the skin file's if None.
        model_error: relative error of the model's change of readings; by default
            MODEL_ERROR, on a pad PAD_MODEL_ERROR.
        rest: readings at rest [taxel, counts], as a baseline has them: readings count from
            there. None: readings are absolute, less the offsets that a calibration wrote
            into the skin file. NaN: the taxel is not used.
        rest_variance: variance of `rest` [taxel, counts^2].
        most_contacts: contacts to tell apart at most, 1 to 3; on a pad to 4.
        live: compile for single frames instead of batches.
        progress: called with what is being done.
        diameter: around which those of contacts on a pad are expected [m]; None tells them.
        pressure_noise: standard deviation of a measured oil pressure [Pa].
        follow_drift: follow the readings at rest in frames without contact, where their times
            are given; with a baseline.
        workers: that solve a pad's table (`fitting.workers`); None: this process, on all
            cores.
        resolution: of a pad's table; None: fine enough for thin membranes.
        load_fields: whether a pressure over the skin is tried where contacts explain a frame
            poorly, and in logs where wide or several ones do; None: on sections, as one takes
            a pad seconds.
        budget: time that a live frame on a pad may take [s]; its status is `coarse` where more
            is left to try, which goes on with the next frames. None: as long as it takes.

    Raises:
        ValueError: an argument or the skin's electrodes can't be used.
    """

    input_errors: InputErrors = field(init=False)
    table: Any = field(init=False)

    def __post_init__(self) -> None:
        self.check()
        # What a membrane remembers comes on top of its long-term response.
        self.spec = self.spec.responding("long-term")
        self.input_errors = input_errors(as_assembled(self.spec))
        self._parts = parts = self._make_parts()
        self.table = parts.table
        self._systematic = parts.systematic
        # What a further contact must gain: as rare as a tenth of a false alarm, and never
        # less than Schwarz's criterion asks for its place and force.
        penalty = parts.detector.threshold(self.false_alarm / 10) ** 2
        asked = (parts.fitter.parameters.places + 1) * np.log(self.taxels)
        given = (
            parts.fitter,
            parts.nodes,
            max(penalty, asked),
            self.most_contacts,
            self._systematic,
            parts.wide_fitter,
        )
        self._budget = None if self.budget is None else Budget(self.budget)
        if self._budget is None:
            self.selection = Selection(*given)
        else:
            self.selection = BoundedSelection(*given, budget=self._budget)
        self._steps, self.step = StepWatch(), 1  # in which counts come, as far as frames show
        self._set_noise(noise_of_readings(self.spec, self.noise))
        discrepancy = None
        if self.spec.geometry.dimension == 2:
            from fitting.inverse_load.discrepancy import ReadingDiscrepancy

            places = np.asarray(self.skin.electrodes.taxels.angle)[:, 0]
            discrepancy = ReadingDiscrepancy.of(self.spec, self.table, places)
        self.frames = FrameEstimator(
            parts,
            self._weights,
            self.selection,
            self.false_alarm,
            discrepancy,
            self.spec.calibration,
            lambda: self._field,
        )
        self.fading = FadingWatch()

    def _set_noise(self, noise: float) -> None:
        """Make what depends on the noise of a reading [counts], as before the first frame."""
        parts, self.reading_noise = self._parts, noise
        self.__dict__.pop("_film", None)  # is made anew when it is next asked for
        reading = self.reading_noise**2 + ROUNDING
        zero, uncertain = zero_of_readings(self.spec, parts.rest, self.rest, self.rest_variance)
        pad = self.spec.geometry.dimension == 3
        assert self.model_error is not None
        self._weights = ReadingWeights(
            zero,
            reading + uncertain,
            parts.rest,
            float(np.hypot(self.model_error, self.table.reading_error if pad else 0.0)),
            self.pressure_noise,
            pad,
        )
        self._lone = LoneTaxels(
            parts.nodes.readings[parts.nodes.known][:, : self.taxels],
            parts.rest,
            parts.nodes.stray,
            self._weights.variance,
        )
        self._drift: DriftFollower | None = None
        if self.follow_drift and self.rest is not None:
            at_rest = np.nan_to_num(self.rest, nan=0.0)
            gathered = _GATHERED_ON_PADS if pad else 1
            self._drift = DriftFollower(at_rest, reading, parts.detector, gathered=gathered)
        memory = LoadMemory.of(self.spec)
        self._memory = memory and self._follower_of(memory)

    def _follower_of(self, memory: LoadMemory) -> "AbstractMemoryFollower":
        """Follows what the membrane remembers."""
        if self.spec.geometry.dimension == 3:
            from fitting.inverse_load.pad.fitter import PadFitter
            from fitting.inverse_load.pad.memory import PadMemoryErrors, PadMemoryFollower

            fitter, errors = self._parts.fitter, self._systematic
            assert isinstance(fitter, PadFitter)
            assert isinstance(errors, PadMemoryErrors)
            own = fitter.interpolant, self.selection, errors
            return PadMemoryFollower(memory, *own, self.reading_noise)
        from fitting.inverse_load.fit.other_stiffness import AbstractSectionErrors
        from fitting.inverse_load.memory.follower import MemoryFollower

        assert self._systematic is None or isinstance(self._systematic, AbstractSectionErrors)
        return MemoryFollower(
            memory,
            self.skin,
            self.table,
            self._systematic,
            direction=self.direction,
            most_contacts=self.most_contacts,
            penalty=self.selection.penalty,
        )

    @property
    def skin(self) -> "Skin":
        """The skin's model; that of a pad is made when it is first needed."""
        return self._parts.make_skin()

    @cached_property
    def _field(self) -> "FieldFallback | None":
        """Load fields; None where they are not wanted, or the membrane remembers."""
        wanted = self.load_fields
        if wanted is None:
            wanted = self.spec.geometry.dimension == 2
        if not wanted or self._memory is not None:
            return None
        from fitting.inverse_load.field.fallback import FieldFallback

        fitter, record = self._parts.fitter, self.spec.calibration
        return FieldFallback(
            self.skin,
            np.atleast_1d(fitter.edge),
            self.along,
            self._systematic,
            per_contact=fitter.per_contact,
            coordinates=fitter.parameters.places,
            scatter=0.0 if record is None else record.force_scatter,
            little_gap=fitter.little_gap,
            live=self.live,
            budget=self._budget,
        )

    @cached_property
    def _film(self) -> FilmFollower | None:
        """Tells motion of the film from loads; None where the file leaves open how it moves.

        Found with the first frames whose times are known: a pad's modes take seconds.
        """
        fading = fading_time(self.spec)
        return None if fading is None else self._film_of(fading)

    def _film_of(self, fading: float) -> FilmFollower:
        """Follows a film whose motion fades in a time [s]."""
        reading = self.reading_noise**2 + ROUNDING
        own = self._parts.nodes, self.taxels, reading, self.frames.alone
        taps = TapFinder(MotionWatch(fading), self._parts.film, *own, self._budget)
        return FilmFollower(FilmMotion(fading, reading), taps, self._weights)

    def _make_parts(self) -> EstimationParts:
        common: dict[str, Any] = {
            "direction": self.direction,
            "live": self.live,
            "most_contacts": self.most_contacts,
            "from_rest": self.rest is not None,
            "progress": self.progress,
        }
        if self.spec.geometry.dimension == 2:
            from fitting.inverse_load.section import section_parts

            return section_parts(self.spec, self.input_errors, **common)
        from fitting.inverse_load.pad.parts import pad_parts
        from fitting.inverse_load.pad.table import FINE

        aside = None if self.budget is None else ThreadPoolExecutor(1, "suas-solve")
        common |= {"workers": self.workers, "resolution": self.resolution or FINE}
        common["aside"] = aside
        return pad_parts(self.spec, self.input_errors, diameter=self.diameter, **common)

    @property
    def remembers(self) -> bool:
        """Whether loads are told with what the membrane remembers, where times are given."""
        return self._memory is not None

    @property
    def taxels(self) -> int:
        """Number of taxels in the layout."""
        return len(self.model_rest)

    @property
    def names(self) -> tuple[str, ...]:
        """What is estimated of a contact, in the order of its covariance."""
        own = self._parts.fitter.parameters.names
        return tuple(self.along.name if name == "angle" else name for name in own)

    @property
    def along(self) -> ContactPlaces:
        """What scenes call places along the skin's arc."""
        return self._parts.assessment.along

    @property
    def posterior(self) -> AbstractLoadPosterior:
        """What sampling a frame's loads needs of the skin."""
        return self._parts.posterior

    @property
    def model_rest(self) -> Floats:
        """The model's readings at rest [taxel] [counts]."""
        return self._parts.rest

    def weigh(
        self,
        so: Floats,
        faulty: Flags | None = None,
        pressure: Floats | None = None,
        drift: Drift | None = None,
    ) -> tuple[Floats, Floats]:
        """Readings as the model has them, and inverse variances: `ReadingWeights.weigh`."""
        return self._weights.weigh(so, faulty, pressure, drift)

    def estimate(
        self,
        so: Floats,
        faulty: Flags | None = None,
        done: Callable[[int], None] = lambda frames: None,
        *,
        pressure: Floats | None = None,
        time: Floats | None = None,
    ) -> list[LoadEstimate]:
        """Estimate the loads of frames.

        Args:
            so: readings [frame, taxel] [counts]; NaN where missing. Readings of 0 and of
                full scale are saturated and left out.
            faulty: taxels known to be faulty [frame, taxel].
            done: called with the number of frames estimated so far.
            pressure: measured of the oil [frame] [Pa]; NaN where missing.
            time: of the frames [frame] [s], in order; what drift, the memory of a membrane
                that relaxes, and motion of the film are followed by. Without it loads are
                those that the long-term constants would need.

        Raises:
            ValueError: the readings don't have a column for every taxel.
        """
        so = np.asarray(so, float)
        if so.ndim != 2 or so.shape[1] != self.taxels:
            raise ValueError(
                f"readings of shape {so.shape}: [frame, {self.taxels}] is needed, one column "
                "a taxel of the layout"
            )
        if faulty is None:
            faulty = np.zeros(so.shape, bool)
        time = None if time is None else np.asarray(time, float)
        if self.live and len(so) and (step := self._steps.feed(so[-1])) != self.step:
            self.step = step
            stated = noise_of_readings(self.spec, self.noise)
            self._set_noise(noise_in_steps(stated, step))
            self.frames.weights = self._weights
        if self._memory is not None:
            if not self.live:  # a log begins at rest; without times it leaves nothing
                self._memory.forget()
            if time is not None:
                return self._remembered(self._memory, so, faulty, time, done)
        if self._budget is not None:
            self._budget.begin()
        past = self.followed(so, faulty, time)
        found = self.estimate_frames(so, faulty, past, done, pressure=pressure)
        return found if time is None else self.in_course(found, so, faulty, time, past)

    def followed(self, so: Floats, faulty: Flags, time: Floats | None) -> PastOfFrames:
        """What the frames before say of each frame; nothing without times."""
        if time is None:
            return PastOfFrames()
        faulty = self._useless(so, faulty)
        return PastOfFrames(self._drifted(so, faulty, time), self._moved(so, faulty, time))

    def _useless(self, so: Floats, faulty: Flags) -> Flags:
        """Taxels that are faulty, or whose readings no load explains [frame, taxel]."""
        change = self._weights.change_from_rest(so, faulty)
        return faulty | self._lone.found(self.model_rest + change)

    def estimate_frames(
        self,
        so: Floats,
        faulty: Flags,
        past: PastOfFrames,
        done: Callable[[int], None] = lambda frames: None,
        *,
        pressure: Floats | None = None,
    ) -> list[LoadEstimate]:
        """Estimate frames whose past is known; other arguments as of `estimate`."""
        size, faulty = 1 if self.live else _BLOCK, self._useless(so, faulty)
        found: list[LoadEstimate] = []
        for begin in range(0, len(so), size):
            part = slice(begin, begin + size)
            if self._budget is not None and begin:
                self._budget.begin()
            measured = None if pressure is None else pressure[part]
            found += self.frames.batch(so[part], faulty[part], measured, *past.rows(part))
            done(len(found))
        return found

    def in_course(
        self,
        found: list[LoadEstimate],
        so: Floats,
        faulty: Flags,
        time: Floats,
        past: PastOfFrames,
    ) -> list[LoadEstimate]:
        """Estimates of frames with what their course tells: taps, and contacts that fade."""
        if self._film is not None:
            found = self._film.with_taps(found, so, faulty, time, past.drift)
        return self._faded(time, found)

    def _faded(self, time: Floats, found: list[LoadEstimate]) -> list[LoadEstimate]:
        if not self.live:
            self.fading = FadingWatch()
        return self.fading.told(time, found)

    def _remembered(
        self,
        memory: "AbstractMemoryFollower",
        so: Floats,
        faulty: Flags,
        time: Floats,
        done: Callable[[int], None],
    ) -> list[LoadEstimate]:
        """Frame after frame, each with what the membrane remembers of those before."""
        found: list[LoadEstimate] = []
        faulty = self._useless(so, faulty)
        moved = self._moved(so, faulty, time)
        for k in range(len(so)):
            row = slice(k, k + 1)
            if self._budget is not None:
                self._budget.begin()
            past = memory.before(float(time[k]))
            # The dent of a load before is not a drift.
            drift = self._drifted(so[row] - past[: self.taxels], faulty[row], time[row])
            motion = None if moved is None else moved[row]
            frame = so[row], faulty[row], None, drift, motion, memory
            estimates: list[LoadEstimate] = []
            shift: Floats | None = past
            while shift is not None:
                estimates = self.frames.batch(*frame, shift)
                shift = memory.again()
            found += estimates
            done(len(found))
        return self._faded(time, found)

    def _moved(self, so: Floats, faulty: Flags, time: Floats) -> Floats | None:
        """What of frames may be motion [frame, taxel] [counts]; None where nothing tells."""
        if self._film is None:
            return None
        if not self.live:
            self._film.forget()
        return self._film.moved(so, faulty, time)

    def _drifted(self, so: Floats, faulty: Flags, time: Floats) -> Drift | None:
        """Drift of the readings at rest in frames; None where it isn't followed."""
        if self._drift is None:
            return None
        return self._drift.follow(time, self._weights.change_from_rest(so, faulty))

    def forget(self) -> None:
        """Live: start the next frame from the table instead of from the last frame."""
        self.selection.forget()
        for follower in (self._memory, self._film, self.fading):
            if follower is not None:
                follower.forget()

    def warm_up(self) -> None:
        """Compile, or load, what a stream needs before the first frame comes."""
        self.forget()  # makes its followers with the budget, which trials do not keep
        shift = 0.0 if self.rest is None else np.nan_to_num(self.rest - self.model_rest)
        time = None if self._memory is None else np.zeros(1)
        if self._field is not None:
            self._field.warm_up(self._parts.trials[0])
        drift, self._drift = self._drift, None  # trials say nothing of it
        budget, self._budget = self._budget, None
        if budget is not None:
            budget.begin(np.inf)
        for _ in range(1 if budget is None else 2):  # the second tells how long steps take
            for trial in self._parts.trials[: self.most_contacts]:
                self.estimate((trial + shift)[None], time=time)
            self.forget()
        self._drift, self._budget, self._steps = drift, budget, StepWatch()
        self.forget()
