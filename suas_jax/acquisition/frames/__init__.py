"""Frames of a device's output: one file a format, and the readings they carry."""
