"""Discretised membranes: what bends, stretches and encloses the oil."""
