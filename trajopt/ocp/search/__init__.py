"""Looking for better solutions: many starts, and following a solution along a parameter."""
