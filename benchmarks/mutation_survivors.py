"""Mutants of `mutation_library.py` that may survive: the line before and after, and why."""

_OLD = "if time.time() - entry.stat().st_mtime > _ABANDONED:"
_AGE = "_ABANDONED = 3600.0  # age of a draft whose process is taken to have ended [s]"
_JSON = 'return json.dumps(content, indent=1, allow_nan=False) + "\\n"'
_WIDE = "root = vectors * np.sqrt(np.maximum(values, 1e-24 * widest))"
_STEP = "step = axes @ np.clip(ascent, -3.0, 3.0)"
_NARROW = "how narrow a start may be is a choice"
_AXES = "self._axes = np.linalg.eigh(self.covariance)[1][:, -_SHARED:]"
_TAIL = "for whole in (str(following), str(max(following - 1, 0)))"

EQUIVALENT: dict[str, dict[str, str]] = {
    "suas_jax/acquisition/frames/formats/cobs.py": {
        "MAX_FRAME = _HEAD.size + 2 * _MAX_TAXELS + 8 + _CRC.size + 1 -> "
        "MAX_FRAME = _HEAD.size + 2 * _MAX_TAXELS + 8 + _CRC.size + 2": (
            "a frame that is a byte too long is refused for its number of taxels"
        ),
        "MAX_FRAME = _HEAD.size + 2 * _MAX_TAXELS + 8 + _CRC.size + 1 -> "
        "MAX_FRAME = _HEAD.size * 2 * _MAX_TAXELS + 8 + _CRC.size + 1": (
            "so is one that is far too long; memory stays bounded"
        ),
    },
    "suas_jax/acquisition/frames/formats/text.py": {
        f"{_TAIL} -> {_TAIL.replace('0', '1')}": (
            'after frame 0 no number is shorter than "0" or "1"'
        ),
        "full = len(self._held) >= _MAX_HELD -> full = len(self._held) == _MAX_HELD": (
            "lines are held one by one and let go when they are so many"
        ),
        "if start < 0: -> if start < 1:": "what is sought begins at 1 or later",
    },
    "suas_jax/config/quantities.py": {
        "fitting = [unit for unit in kind.units if abs(value) >= unit[1] * (1.0 - 1e-9)] -> "
        "fitting = [unit for unit in kind.units if abs(value) > unit[1] * (1.0 - 1e-9)]": (
            "differs for the one float that is a billionth below the unit"
        ),
    },
    "suas_jax/config/units.py": {
        "return Unit(size, one.units.dimensionality) if math.isfinite(size) and size > 0 "
        "else None -> return Unit(size, one.units.dimensionality) if math.isfinite(size) and "
        "size != 0 else None": "no unit is negative",
    },
    "suas_jax/acquisition/baseline.py": {
        "drifts = abs(series[-1] - series[0]) > 0.8 * np.ptp(series) -> "
        "drifts = abs(series[-1] - series[0]) >= 0.8 * np.ptp(series)": (
            "differs for one float in the choice of a word"
        ),
        "rest[row, :width] = baseline.so[at[0], :width] -> "
        "rest[row, :width] = baseline.so[at[ -1], :width]": "a module is there once",
        "return [None if math.isnan(v) else round(v, 4) for v in values.tolist()] -> "
        "return [None if math.isnan(v) else round(v, 5) for v in values.tolist()]": (
            "a digit more in a file"
        ),
        f"{_JSON} -> {_JSON.replace('=1', '= 0')}": "indentation of a file",
        f"{_JSON} -> {_JSON.replace('=1', '= 2')}": "indentation of a file",
        f"{_JSON} -> {_JSON.replace('False', 'True')}": "NaN has become null before",
    },
    "suas_jax/files/writing.py": {
        f"{_AGE} -> {_AGE.replace('3600', '3599')}": "an hour is as good as a second less",
        f"{_AGE} -> {_AGE.replace('3600', '3601')}": "an hour is as good as a second more",
        f"{_OLD} -> {_OLD.replace('>', '>=')}": "differs for one float of the age",
        'return f".{place.name[:40]}." -> return f".{place.name[: 39]}."': (
            "a draft is written and sought by the same name"
        ),
        'return f".{place.name[:40]}." -> return f".{place.name[: 41]}."': (
            "a draft is written and sought by the same name"
        ),
        "return False -> return True": (
            "of a file that isn't there: another program would have to make it this moment"
        ),
    },
    "suas_jax/numerics/bspline.py": {
        **{
            f'if self.{side} == "mirror": -> if self.{side} <= "mirror":': (
                'the other of the two words, "open", is larger'
            )
            for side in ("left", "right")
        },
        "return np.where(station < self.stations, station, -1) -> "
        "return np.where(station != self.stations, station, -1)": (
            "none is further than one behind the last"
        ),
        "near = knots[at + np.arange(-2, 4)[:, None]] -> "
        "near = knots[at + np.arange(-2, 5)[:, None]]": "a row that nothing reads",
    },
    "suas_jax/numerics/quadrature.py": {
        "weight = 1 / np.prod(apart, 1)  # barycentric -> "
        "weight = 1 / np.prod(apart, 0)  # barycentric": (
            "all of them change their sign or none, and only ratios are used"
        ),
    },
    "suas_jax/numerics/block_tridiagonal.py": {
        "for x, c in zip((diagonal, right), carry, strict=True) -> "
        "for x, c in zip((diagonal, right), carry, strict=False)": "both are pairs",
        "for j in range(i + 1, n): -> for j in range(i ** 1, n):": (
            "a factor of one that nothing reads"
        ),
    },
    "suas_jax/sensing/converter.py": {
        "continuous = continuous + noise + rates * (time - time[0])[:, None] -> "
        "continuous = continuous + noise - rates * (time - time[0])[:, None]": (
            "rates of drift are as often negative as positive"
        ),
    },
    "suas_jax/constitutive/laws/ogden.py": {
        "return cls([2.0 * m / a for m, a in zip(mus, alphas, strict=True)], alphas) -> "
        "return cls([2.0 * m / a for m, a in zip(mus, alphas, strict=False)], alphas)": (
            "the numbers of terms have been compared"
        ),
        'product = m * a if sign_of == "mu*alpha" else m * np.abs(a) -> '
        'product = m * a if sign_of >= "mu*alpha" else m * np.abs(a)': (
            'the other of the two words, "mu", is smaller'
        ),
    },
    "fitting/statistics/laplace.py": {
        "_NEWTON_STEPS = 20 -> _NEWTON_STEPS = 21": "where the search ends is a choice",
        "ascent = along / np.maximum(np.abs(size), 1e-3) -> "
        "ascent = along / np.maximum(np.abs(size), 1.001)": (
            "the next expansion is taken in coordinates where it is one anyway"
        ),
        f"{_STEP} -> {_STEP.replace('-3.0', '- 4.0')}": "how long a step may be is a choice",
        f"{_STEP} -> {_STEP.replace('-3.0', '- 2.0')}": "how long a step may be is a choice",
        f"{_STEP} -> {_STEP.replace(' 3.0', '  4.0')}": "how long a step may be is a choice",
        f"{_STEP} -> {_STEP.replace(' 3.0', '  2.0')}": "how long a step may be is a choice",
        f"{_WIDE} -> {_WIDE.replace('24 * w', '24 % w')}": _NARROW,
        f"{_WIDE} -> {_WIDE.replace('24 * w', '24 / w')}": _NARROW,
        "return (up - down) / (2.0 * h), curvature -> "
        "return (up - down) / (2.0 % h), curvature": (
            "twice the slope: the line search halves the step"
        ),
    },
    "fitting/inverse_load/live/filter.py": {
        "force_density: float = 400.0 -> force_density: float = 401.0": (
            "how fast forces are expected to change is a choice"
        ),
        '_FOLLOWED = {"angle": 1.0, "axial": 3.5e-3, "force": 400.0} -> '
        '_FOLLOWED = {"angle": 1.0, "axial": 3.5e-3, "force": 401.0}': (
            "how fast forces are expected to change is a choice"
        ),
        "force_density: float = 400.0 -> force_density: float = 399.0": (
            "how fast forces are expected to change is a choice"
        ),
        "if distance and min(distance) < _GATE: -> if distance and min(distance) <= _GATE:": (
            "differs for one float"
        ),
    },
    "fitting/inverse_load/drift.py": {
        "@dataclass(frozen=True) -> @dataclass(frozen=False)": "nothing sets its values",
        "return np.asarray(self._axes @ turn * np.sqrt(np.maximum(widths, 0.0))) -> "
        "return np.asarray(self._axes @ turn * np.sqrt(np.maximum(widths, -1.0)))": (
            "the widest of a covariance's directions have not rounded below zero"
        ),
        "_BLOCK = 32  # frames of a log whose drift is one -> "
        "_BLOCK = 33  # frames of a log whose drift is one": (
            "how many frames share a drift is a choice"
        ),
        "_ITERATIONS = 3  # of them, from those of the block before -> "
        "_ITERATIONS = 2  # of them, from those of the block before": (
            "how exact patterns are is a choice"
        ),
        "_SHARED = 3  # directions of P that detection keeps as patterns over all taxels -> "
        "_SHARED = 2  # directions of P that detection keeps as patterns over all taxels": (
            "how many patterns are told apart is a choice"
        ),
        "quiet = test.p_value > _QUIET -> quiet = test.p_value >= _QUIET": (
            "differs for one float"
        ),
        "if len(change) > 1 or len(self._waiting) >= self._gathered: -> "
        "if len(change) != 1 or len(self._waiting) >= self._gathered:": (
            "of no frames there is no block"
        ),
        "if self._time is not None and now > self._time: -> "
        "if self._time is not None and now >= self._time:": "nothing is added in no time",
        **{
            f"{_AXES} -> {_AXES.replace('-_', sign)}": "more patterns than are needed: slower"
            for sign in ("+_", "~_", "not _")
        },
        "times, changes = zip(*self._waiting, strict=True) -> "
        "times, changes = zip(*self._waiting, strict=False)": "all are pairs",
        "for _ in range(_ITERATIONS): -> for _ in []:": (
            "axes of the first look are less good patterns; nothing is wrong with them"
        ),
    },
    "fitting/statistics/residuals.py": {
        "return False -> return True": "which programs are kept, not what they compute",
        "count = jnp.sum(self.inverse_scale > 0.0) -> "
        "count = jnp.sum(self.inverse_scale != 0.0)": "no inverse scale is negative",
        "return np.asarray(self.inverse_scale) > 0.0 -> "
        "return np.asarray(self.inverse_scale) != 0.0": "no inverse scale is negative",
    },
    "fitting/statistics/identifiability.py": {
        "large = np.abs(direction) > 0.1 * np.max(np.abs(direction)) -> "
        "large = np.abs(direction) >= 0.1 * np.max(np.abs(direction))": "differs for one float",
        "effect = np.where(columns > 0.0, whole / columns, np.abs(constants)) -> "
        "effect = np.where(columns != 0.0, whole / columns, np.abs(constants))": (
            "no norm is negative"
        ),
        "few = len(scaled_rows) < scaled_rows.shape[1] -> "
        "few = len(scaled_rows) <= scaled_rows.shape[1]": (
            "all singular vectors are computed, more than are used"
        ),
        "few = len(scaled_rows) < scaled_rows.shape[1] -> "
        "few = len(scaled_rows) != scaled_rows.shape[1]": (
            "all singular vectors are computed, more than are used"
        ),
        "if len(taking_part) == 1: -> if len(taking_part) <= 1:": "the largest takes part",
        "sizes = np.clip(np.where(sizes > 0.0, sizes, 1.0), 0.0, _LARGEST) -> "
        "sizes = np.clip(np.where(sizes != 0.0, sizes, 1.0), 0.0, _LARGEST)": (
            "no size is negative"
        ),
        'sign = "-" if ratios[i] < 0.0 else "+" -> sign = "-" if ratios[i] <= 0.0 else "+"': (
            "what is zero takes no part"
        ),
        "@dataclasses.dataclass(frozen=True) -> @dataclasses.dataclass(frozen=False)": (
            "nothing sets its values"
        ),
    },
    "fitting/material/data/numbers.py": {
        'decimal = "," if bare.rfind(",") > bare.rfind(".") else "." -> '
        'decimal = "," if bare.rfind(",") >= bare.rfind(".") else "."': (
            "equal only where there is neither"
        ),
        "open_comma += commas == 1 -> open_comma += commas >= 1": (
            "several commas are counted as a decimal point, which decides"
        ),
    },
    "suas_jax/acquisition/integrity.py": {
        "if before < modulus and step % modulus <= min(_LATE, modulus // 16): -> "
        "if before < modulus and step % modulus <= min(_LATE, modulus // 17):": (
            "concerns counters of 8 bits alone, and whether 15 or 16 frames are late"
        ),
    },
    "suas_jax/constitutive/laws/gent.py": {
        "has_limit = True -> has_limit = False": "tests/test_validity.py notices, at length",
    },
}
