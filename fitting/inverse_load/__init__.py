"""Where, how strongly and how surely a skin is touched, from its readings."""
