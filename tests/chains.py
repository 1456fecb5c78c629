"""What the tests of loads' posteriors ask of a chain."""

import numpy as np

from fitting.inverse_load.frame_posterior import LoadMode


def assert_chain_agrees_with_the_mode(mode: LoadMode) -> None:
    """All probability is one mode's, and its chain has the fit's mean and covariance."""
    assert mode.probability > 0.99
    assert mode.chain is not None
    spread = np.sqrt(np.diag(mode.covariance))
    np.testing.assert_allclose(mode.chain.samples.std(0), spread, rtol=0.25)
    shift = (mode.chain.samples.mean(0) - mode.parameters) / spread
    np.testing.assert_allclose(shift, 0.0, atol=0.3)
