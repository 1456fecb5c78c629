"""Contacts on a pad, in three dimensions: their table, its spline, fits of them."""
