"""Material laws, declared one a file.

The energy is in the file of the same name in `suas_jax.constitutive.laws`.
"""
