"""Contact of the membrane's inner face with the wall: a local term of the energy."""
