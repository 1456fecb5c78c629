"""Estimated contacts with their covariances and a status by name."""
