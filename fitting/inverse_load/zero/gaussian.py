"""Linear Bayesian update of a Gaussian, iterated where the model is not linear."""

from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats


class Gaussian(NamedTuple):
    """A normal distribution."""

    mean: Floats  # [parameter]
    covariance: Floats  # [parameter, parameter]


def conditioned(
    prior: Gaussian, at: Floats, jacobian: Floats, residual: Floats, weight: Floats
) -> Gaussian:
    """The posterior after measurements y = h(x) + noise, with h linear about a point.

    With r = y - h(x_0) and J = dh/dx there, P = (P_0^-1 + J^T W J)^-1 and
    x = x_0 + P (J^T W r + P_0^-1 (m - x_0)). Repeated at its own mean it is the
    Gauss-Newton method for the most probable x.

    The prior is one of full rank; the point is x_0 [parameter], with J [measurement, parameter]
    and r [measurement] there. Weights are inverse variances of the noise, zero where nothing
    was measured [measurement].
    """
    before = np.linalg.inv(prior.covariance)
    information = before + jacobian.T @ (weight[:, None] * jacobian)
    covariance = np.linalg.inv(information)
    pull = jacobian.T @ (weight * residual) + before @ (prior.mean - at)
    return Gaussian(at + covariance @ pull, (covariance + covariance.T) / 2)
