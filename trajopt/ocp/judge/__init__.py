"""How good a solution on a mesh is: errors between the nodes, costates, playback."""
