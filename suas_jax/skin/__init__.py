"""The skin itself: dimensions, oil, and the loads that act on it."""
