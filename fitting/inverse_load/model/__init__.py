"""Readings of one skin under contacts, with derivatives by all of their parameters."""
