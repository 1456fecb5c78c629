"""A scene from its configuration to solved, reported and differentiated results."""
