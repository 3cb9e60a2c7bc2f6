"""zeggs-jax: co-speech gesture generation in JAX."""
