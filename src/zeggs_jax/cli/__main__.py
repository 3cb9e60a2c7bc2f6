"""`python -m zeggs_jax.cli` is `zeggs`."""

from . import main

if __name__ == "__main__":
    main()
