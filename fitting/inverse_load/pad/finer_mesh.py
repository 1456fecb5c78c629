"""Forces at which a table's mesh reads what a finer mesh reads.

A coarse mesh is too stiff: by 0.1 to 0.2 % of the force on the default one, evenly enough over
the taxels that a larger force makes up for it. The share e is found where few places are solved
on both meshes, from readings SO at the same force F, and is smooth in between::

    SO_coarse(F (1 + e)) = SO_fine(F),   e = s.(SO_fine - SO_coarse) / (F s.s),   s = dSO/dF
"""

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.columns import Column

_MOST = 0.05  # a mesh that differs by more differs in the shape of its readings, too


def force_surplus(coarse: Column, fine: Column, levels: Floats) -> Floats:
    """Share e of the force by which the coarse mesh has to be loaded more [place, level].

    Readings are those on the table's mesh and on the finer one [place, level, taxel]; levels
    are shares of the largest force, none of them zero.
    Returns the share, 5 % at most; that of the next lighter load where a mesh has no solution,
    and zero where there is none.
    """
    slope = np.gradient(coarse.so, levels, axis=1)
    both = np.isfinite(slope) & np.isfinite(fine.so) & np.isfinite(coarse.so)
    slope = np.where(both, slope, 0.0)
    change = np.where(both, fine.so - coarse.so, 0.0)
    size = np.sum(slope**2, -1)
    good = coarse.found & fine.found & (size > 0)
    share = np.sum(slope * change, -1) / np.where(good, size, 1.0) / levels
    share = np.clip(share, -_MOST, _MOST)
    for k in range(share.shape[1]):
        before = share[:, k - 1] if k else 0.0
        share[:, k] = np.where(good[:, k], share[:, k], before)
    return np.asarray(share)
