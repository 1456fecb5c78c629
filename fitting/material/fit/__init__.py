"""The fit of a law to measurements, and its posterior."""
