"""Memory of a membrane that relaxes: what it answers to loads now, after all loads before."""
