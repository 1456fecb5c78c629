"""A membrane's constants from test-machine data and from the skin's own curve."""
