"""Ends of a skin's range of forces: at the wall, in noise, at the converter's limit."""
