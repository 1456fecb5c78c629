"""Where a skin's range of forces ends: at the wall, in noise, at the converter's limit."""
