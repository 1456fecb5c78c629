"""Files of test machines read into measurements in SI units."""
