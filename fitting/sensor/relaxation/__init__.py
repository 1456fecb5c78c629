"""Relaxation of a skin's rubber from presses that are held on the skin itself."""
