"""A skin's readings without hardware: load paths and the pattern at rest."""
