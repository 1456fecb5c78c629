"""Covariances of estimated loads: inverses of the information of their fits."""

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations

_SINGULAR = 1e-13  # of a scaled matrix, whose diagonal is one
_RIDGE = 1e-9  # which leaves it positive definite where a direction is not determined


def covariance_of(best: Explanations, per_contact: int) -> Floats:
    """Covariances of the parameters, padded as the information is."""
    covariance = np.full(best.information.shape, np.nan)
    for count in np.unique(best.contacts):
        frames, width = best.contacts == count, per_contact * int(count)
        covariance[frames, :width, :width] = inverse(best.information[frames, :width, :width])
    return covariance


def whitened(jacobian: Floats, information: Floats) -> Floats:
    """L^-1 J with L L^T the information [frame, p, taxel]; zero where nothing is known."""
    scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    known = np.isfinite(scale) & (scale > 0)
    over = np.where(known, 1 / np.where(known, scale, 1.0), 0.0)
    eye = np.eye(information.shape[-1])
    scaled = np.nan_to_num(information * over[:, :, None] * over[:, None]) + _RIDGE * eye
    scaled = np.where(known[:, :, None] | (eye == 0), scaled, 1.0)
    rows = np.nan_to_num(jacobian * over[..., None])
    return np.asarray(np.linalg.solve(np.linalg.cholesky(scaled), rows))


def inverse(information: Floats) -> Floats:
    """Covariances from information [frame, p, p]; infinite where nothing is determined."""
    size = information.shape[-1]
    scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    known = scale > 0
    safe = np.where(known, scale, 1.0)
    outer = safe[:, :, None] * safe[:, None]
    # Scaled, its diagonal is one: rounding can't hide a direction but below 1e-12.
    eye = np.eye(size)
    scaled = np.where(known[:, :, None] & known[:, None], information / outer, eye)
    scaled = np.where(np.isfinite(scaled), scaled, eye)
    covariance = np.linalg.inv(scaled + _SINGULAR * eye) / outer
    unknown = ~known[:, :, None] & (eye > 0)
    return np.asarray(np.where(unknown, np.inf, covariance))
