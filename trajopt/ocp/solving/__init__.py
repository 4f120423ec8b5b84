"""Solving a problem: from a guess to a local minimum on a mesh that is fine enough."""
