"""Posing a problem: phases of smooth motion, linkages, bounds and costs."""
