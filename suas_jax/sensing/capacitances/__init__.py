"""Models of a taxel's capacitance, one a file; their names are those of the files.

Base class and registry: `suas_jax.sensing.capacitance`.
"""
