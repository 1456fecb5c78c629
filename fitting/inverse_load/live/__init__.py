"""Loads from a port as they happen."""
