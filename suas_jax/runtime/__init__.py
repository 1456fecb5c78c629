"""Settings of the JAX runtime, and compiled programs kept between runs."""
