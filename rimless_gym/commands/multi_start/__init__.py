"""Local optima of a problem, searched for from many starts."""
