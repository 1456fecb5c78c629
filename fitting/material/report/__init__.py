"""A material fit as JSON, text and figures."""
