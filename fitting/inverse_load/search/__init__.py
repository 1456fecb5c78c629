"""Starts of a fit of loads: a table of solved states."""
