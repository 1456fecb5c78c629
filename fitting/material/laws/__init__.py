"""The laws that can be fitted, and their parameters."""
