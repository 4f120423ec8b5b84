"""Posing a problem: phases of smooth motion, linkages between them, bounds and costs."""
