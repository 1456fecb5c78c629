"""The guided calibration of a skin on a port: rest, known presses, fit, verification."""
