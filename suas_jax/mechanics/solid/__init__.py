"""The plane-strain finite-element model of the membrane."""
