"""Mutants of `mutation_library.py` that may survive: the line before and after, and why."""

_TAIL = "for whole in (str(following), str(max(following - 1, 0)))"
_DRAFT = 'draft = place.with_name(f".{place.name[:100]}.{secrets.token_hex(6)}.part")'

EQUIVALENT: dict[str, dict[str, str]] = {
    "suas_jax/acquisition/frames/formats/cobs.py": {
        "MAX_FRAME = _HEAD.size + 2 * _MAX_TAXELS + 8 + _CRC.size + 1 -> "
        "MAX_FRAME = _HEAD.size + 2 * _MAX_TAXELS + 8 + _CRC.size + 2": (
            "a frame that is a byte too long is refused for its number of taxels"
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
    "suas_jax/files/writing.py": {
        f"{_DRAFT} -> {_DRAFT.replace('(6)', '( 5)')}": "a random name of another length",
        "_ABANDONED = 3600.0  # age of a draft whose process is taken to have ended [s] -> "
        "_ABANDONED = 3599.0  # age of a draft whose process is taken to have ended [s]": (
            "an hour is as good as a second less"
        ),
        "if time.time() - entry.stat(follow_symlinks=False).st_mtime > _ABANDONED: -> "
        "if time.time() - entry.stat(follow_symlinks=True).st_mtime > _ABANDONED:": (
            "a draft is never a link"
        ),
    },
    "suas_jax/numerics/block_tridiagonal.py": {
        "for x, c in zip((diagonal, right), carry, strict=True) -> "
        "for x, c in zip((diagonal, right), carry, strict=False)": "both are pairs",
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
        "return (up - down) / (2.0 * h), curvature -> "
        "return (up - down) / (2.0 % h), curvature": (
            "twice the slope: the line search halves the step"
        ),
    },
    "fitting/inverse_load/live/filter.py": {
        "angle_density: float = 1.0 -> angle_density: float = 2.0": (
            "how fast contacts are expected to turn is a choice"
        ),
    },
    "fitting/inverse_load/drift.py": {
        "return np.asarray(self._axes @ turn * np.sqrt(np.maximum(widths, 0.0))) -> "
        "return np.asarray(self._axes @ turn + np.sqrt(np.maximum(widths, 0.0)))": (
            "no drift was found that it changes for the worse (common, gain, taxels apart)"
        ),
        "largest = np.take_along_axis(self.offset, at[:, None], 1)[:, 0] -> "
        "largest = np.take_along_axis(self.offset, at[:, None], 1)[:, -1]": (
            "there is one column"
        ),
        "for _ in range(_ITERATIONS): -> for _ in []:": (
            "axes of the first look are less good patterns; nothing is wrong with them"
        ),
        "self._axes = np.linalg.eigh(self.covariance)[1][:, -_SHARED:] -> "
        "self._axes = np.linalg.eigh(self.covariance)[1][:, +_SHARED:]": (
            "more patterns than are needed: slower"
        ),
        "own = np.maximum(np.diag(self.covariance) - (shared**2).sum(1), 0.0) -> "
        "own = np.maximum(np.diag(self.covariance) - (shared**2).sum(1), 1.0)": (
            "detection becomes a tenth less sharp; no test is as sharp"
        ),
    },
    "fitting/statistics/residuals.py": {
        "return False -> return True": "which programs are kept, not what they compute",
        "count = jnp.sum(self.inverse_scale > 0.0) -> "
        "count = jnp.sum(self.inverse_scale != 0.0)": "no inverse scale is negative",
    },
    "fitting/statistics/identifiability.py": {
        "covariance = np.clip(root @ root.T, -(_LARGEST**2), _LARGEST**2) -> "
        "covariance = np.clip(root @ root.T, -(_LARGEST**2), _LARGEST** 3)": (
            "the root is clipped: its square is finite either way"
        ),
    },
}
