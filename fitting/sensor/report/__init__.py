"""A sensor calibration as JSON, text, figures and a calibrated skin file."""
