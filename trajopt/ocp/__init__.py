"""Optimal control of hybrid systems by direct collocation: an engine that knows no wheel."""
