"""Counts of a skin as a function of the constants that a calibration finds."""
