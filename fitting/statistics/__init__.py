"""Estimation that knows no physics: least squares, posteriors, diagnostics."""
