"""Measures of generated motion, with their constants stated."""
