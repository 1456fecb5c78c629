"""Kinds of test: their columns, their scale, and what a law predicts for them."""
