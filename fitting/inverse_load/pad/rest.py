"""Readings of a pad that nothing touches."""

import numpy as np

from fitting.arrays import Floats
from suas_jax.scene.pad_forward import PadSkin, Patches, pad_forward


def rest_readings(skin: PadSkin) -> Floats:
    """Readings of the pad without contacts [taxel] [counts]."""
    if skin.prestressed:
        none = Patches.poke(0.0, 0.0, 0.0, float(skin.geometry.thickness[0]))
        return np.asarray(pad_forward(skin, none, skin.meshes(none)).so)[:, 0]
    so = skin.electrodes.read_even_film(skin.geometry.oil_gap)
    return np.broadcast_to(np.asarray(so)[:, 0], (len(skin.electrodes.taxels.angle),)).copy()


def stray_counts(skin: PadSkin) -> Floats:
    """Part of the readings that no gap changes [taxel] [counts]."""
    taxels = len(skin.electrodes.taxels.angle)
    counts = np.asarray(skin.electrodes.stray / skin.electrodes.lsb, float).reshape(-1)
    return np.broadcast_to(counts, (taxels,)).copy()
