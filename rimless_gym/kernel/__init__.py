"""The stepping kernel: tiles of wheels advanced by one control interval, compiled by numba."""
