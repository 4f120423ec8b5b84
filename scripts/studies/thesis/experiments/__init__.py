"""The thesis's six numerical experiments, solved, verified and compared with what it printed."""
