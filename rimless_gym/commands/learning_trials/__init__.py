"""Short trials behind docs/learning.md: why standing still wins, and which gaits luck finds."""
