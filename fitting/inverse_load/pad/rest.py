"""Readings of a pad that nothing touches."""

import numpy as np

from fitting.arrays import Floats
from suas_jax.scene.skin import Skin


def film_readings(skin: Skin) -> Floats:
    """Readings of the undeformed pad [taxel] [counts]."""
    taxels = skin.electrodes.taxels
    gap = skin.geometry.gap(taxels.angle, taxels.axial)
    so = skin.electrodes.read_even_film(gap)
    return np.broadcast_to(np.asarray(so)[:, 0], (len(taxels.angle),)).copy()


def stray_counts(skin: Skin) -> Floats:
    """Part of the readings that no gap changes [taxel] [counts]."""
    taxels = len(skin.electrodes.taxels.angle)
    counts = np.asarray(skin.electrodes.stray / skin.electrodes.lsb, float).reshape(-1)
    return np.broadcast_to(counts, (taxels,)).copy()
