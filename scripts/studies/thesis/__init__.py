"""The studies of the thesis: its experiments solved, and whether its prototype can walk."""
