"""Programs that each measure one thing. Those of peers run in the peers' own environments."""
