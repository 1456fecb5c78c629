"""The data sheet of a skin: what it will measure, how well, and what decides that."""
