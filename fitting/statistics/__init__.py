"""Estimation that knows no physics: least squares, bounds, posteriors, diagnostics."""
