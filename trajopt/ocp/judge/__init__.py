"""How good a solution is: errors between nodes, costates, playback; and what to refine."""
