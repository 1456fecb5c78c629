"""Contact of the membrane's faces with rigid surfaces: a local term of the energy."""
