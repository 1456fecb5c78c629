"""Least squares for a sensor calibration, its priors, checks and posterior."""
