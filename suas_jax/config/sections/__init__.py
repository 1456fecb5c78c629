"""The kinds of section, one for each file."""
