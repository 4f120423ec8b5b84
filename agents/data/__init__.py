"""Walks as Minari datasets, for other people's offline learners."""
