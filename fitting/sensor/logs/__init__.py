"""Logs of an experiment with known inputs."""
