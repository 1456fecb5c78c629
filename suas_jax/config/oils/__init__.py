"""Oil models, declared one a file.

The equation is in the file of the same name in `suas_jax.skin.oils`.
"""
