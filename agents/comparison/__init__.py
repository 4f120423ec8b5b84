"""Learned against optimal cost of transport, on one machine, at equal speed."""
