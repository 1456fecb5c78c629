"""Zeroing: what known presses say of the inputs that move forces and not the baseline."""
