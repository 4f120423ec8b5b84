"""The figures, tables and measured numbers of docs/physics.md and docs/thesis-errata.md."""
