"""A simulated device that sends frames, with faults on demand."""
