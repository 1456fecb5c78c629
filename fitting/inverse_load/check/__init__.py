"""Verdicts of a whole log, beyond its frames: whether the skin file explains it."""
