"""Looking for better solutions: many starts, and continuation along a parameter."""
