"""The log of sensor outputs: written append-only, read strictly, converted."""
