"""Estimated loads as JSON, text and figures."""
