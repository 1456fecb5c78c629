"""Where a fit of loads begins: a table of solved states."""
