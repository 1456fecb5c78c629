"""The thin-shell model of the whole pad, in three dimensions."""
