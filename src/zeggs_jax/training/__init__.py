"""Train state, loop, optimiser and checkpoints, for any network."""
