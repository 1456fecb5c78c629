"""From a serial port to a log that loses nothing.

Nothing here imports JAX: the logger has to open its port within a second.
"""
