"""Gaits of the rimless wheel as optimal control problems, verified on the hybrid model."""
