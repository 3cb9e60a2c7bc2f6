"""A synthetic corpus with known ground truth, free of licences."""
