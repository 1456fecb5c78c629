"""States of a skin that span a log's surroundings.

Where temperature or depth change by more than one state of a skin stands for, states lie on a
grid, and each frame has shares of those around it: bilinear in temperature and depth.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.readings import LogReadings
from fitting.inverse_load.zero.zero_file import aged
from fitting.surroundings import spec_at, spec_in, told_at_mean
from suas_jax.config import SkinSpec
from suas_jax.config.quantities import ZERO_CELSIUS

_APART = {"temperature": 5.0, "depth": 300.0}  # between states at most [K], [m]
_IN_WORDS: dict[str, Callable[[float], str]] = {
    "temperature": lambda kelvin: f"{kelvin - ZERO_CELSIUS:.3g} degC",
    "depth": lambda metres: f"{metres:.3g} m deep",
}
_LEAST = 1e-9  # share of a state that counts
_MOST = 0.5  # share of a frame's states that must be there


@dataclass(frozen=True)
class SkinStates:
    """States of a skin that span a log, and where its frames lie between them."""

    specs: tuple[SkinSpec, ...]
    names: tuple[str, ...]  # in words
    # of each state in each frame; at most two along each of the surroundings are not zero
    share: Floats  # [frame, state]
    said: tuple[str, ...]  # what a person should know

    @property
    def nearest(self) -> Rows:
        """The state that each frame is nearest to."""
        return np.asarray(self.share.argmax(1))

    @property
    def known(self) -> Flags:
        """Frames that have states around them."""
        return np.asarray(self.share.any(1))

    def without(self, lost: Sequence[bool]) -> "SkinStates":
        """Those that there are: others stand in for lost ones, unless these have most of it."""
        kept = ~np.array(lost)
        if kept.all():
            return self
        share = self.share[:, kept]
        left = share.sum(1, keepdims=True)
        names = ", ".join(name for name, gone in zip(self.names, lost, strict=True) if gone)
        away = int((left < _MOST).sum())
        said = (
            f"at {names} the skin file's skin buckles without a load; {away} frames near that "
            "are not estimated (model_mismatch)"
        )
        return SkinStates(
            tuple(np.array(self.specs, object)[kept]),
            tuple(np.array(self.names, object)[kept]),
            np.where(left < _MOST, 0.0, share / np.where(left > 0, left, 1.0)),
            (*self.said, said),
        )


def skin_states(spec: SkinSpec, readings: LogReadings, where: str) -> SkinStates:
    """The states of a skin in a log's surroundings; one where these hardly change.

    A membrane that remembers is taken at their mean. `where` names the log, for messages.
    """
    around, frames = readings.surroundings, len(readings.time)
    mean, said = spec_at(spec, around, where)
    if around.temperature is None:
        mean, more = aged(mean, readings.header.get("start_time", ""), np.ptp(readings.time))
        said += more
    changing = {k: x for k, x in around.changing(spec)._asdict().items() if x is not None}
    if changing and spec.material.relaxation is not None:
        said += told_at_mean(around, spec)
        changing = {}
    if not changing:
        return SkinStates((mean,), ("",), np.ones((frames, 1)), tuple(said))
    axes, shares = [], []
    for name, column in changing.items():
        # By frames, not times: a device's clock may begin again.
        known = np.flatnonzero(np.isfinite(column.value))
        value = np.interp(np.arange(frames), known, column.value[known])
        low, high = column.ends
        nodes = np.linspace(low, high, 1 + int(np.ceil((high - low) / _APART[name] - 1e-9)))
        axes.append(nodes)
        place = (value - low) / (nodes[1] - nodes[0])
        shares.append(np.maximum(1 - np.abs(place[:, None] - np.arange(len(nodes))), 0.0))
    specs, names, share = [], [], []
    for rows in itertools.product(*(range(len(nodes)) for nodes in axes)):
        own = np.prod([s[:, k] for s, k in zip(shares, rows, strict=True)], 0)
        own = np.where(own < _LEAST, 0.0, own)
        if not own.any():
            continue
        at = {name: float(x[k]) for name, x, k in zip(changing, axes, rows, strict=True)}
        specs.append(spec_in(mean, **at))
        names.append(", ".join(_IN_WORDS[name](x) for name, x in at.items()))
        share.append(own)
    said.append(f"{where}: frames are estimated between {len(specs)} states of the skin")
    return SkinStates(tuple(specs), tuple(names), np.stack(share, 1), tuple(said))
