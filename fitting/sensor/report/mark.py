"""What tells files that `suas fit sensor` wrote."""

MARK = "written by suas fit sensor"
"""Words of a comment in the file; the next run may replace it under its own name."""
