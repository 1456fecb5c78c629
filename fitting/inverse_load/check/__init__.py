"""What a whole log says beyond its frames: whether the skin file explains it."""
