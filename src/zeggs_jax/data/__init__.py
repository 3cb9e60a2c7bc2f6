"""Corpora: pairs of speech and motion, made into arrays and batches."""
