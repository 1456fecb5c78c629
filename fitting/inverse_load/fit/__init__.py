"""Least squares for loads: model, covariance, number of contacts, posterior."""
