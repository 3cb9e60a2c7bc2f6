"""Golden-vector checks, one module per stage of the PyTorch release."""
