"""Rotations: quaternions and two-axis rotations, free of bodies and files."""
