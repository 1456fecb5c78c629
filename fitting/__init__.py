"""Tools that fit the skin's model to measurements."""
