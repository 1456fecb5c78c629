"""The pad as a solid: a continuum in three dimensions."""
