"""ZeroEGGS (Ghorbani et al., CGF 2023): zero-shot example-based gesture generation from speech."""
