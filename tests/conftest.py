"""Settings of every test: no silent rank promotion, no GPU, no compile cache."""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax

jax.config.update("jax_numpy_rank_promotion", "raise")
