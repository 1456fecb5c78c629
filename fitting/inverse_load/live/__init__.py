"""Loads from a port, frame by frame."""
