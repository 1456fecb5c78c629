"""Numerical building blocks without physics: quadrature, splines, structured linear algebra."""
