"""Layers with the initialisers and layouts of the PyTorch release."""
