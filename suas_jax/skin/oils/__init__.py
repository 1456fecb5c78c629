"""Oil models, one file each.

The constants are declared in the file of the same name in `suas_jax.config.oils`.
"""
