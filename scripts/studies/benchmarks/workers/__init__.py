"""Programs that each measure one thing. Those of peers run in the peers' own environments.

They run as modules of a top-level package `benchmarks`, and import its other files relatively:
importing `rimless_gym` would need packages that peers' environments do not have.
"""
