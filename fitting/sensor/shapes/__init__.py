"""The membrane's shape in every known state of an experiment."""
