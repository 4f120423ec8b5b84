"""From a problem to a nonlinear program: schemes, meshes, unknowns, constraints, IPOPT."""
