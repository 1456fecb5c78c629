"""The skin for a data sheet: dimensions and materials found by exact derivatives."""
