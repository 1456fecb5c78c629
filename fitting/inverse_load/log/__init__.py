"""Loads of a whole log, whose skin may warm and sink: states of the skin, and between them."""
