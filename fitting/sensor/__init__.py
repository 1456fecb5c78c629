"""Oil permittivity, gap and scale of a skin from logged sensor outputs."""
