"""The front of least cost of transport over speed, searched as a rival would search it."""
