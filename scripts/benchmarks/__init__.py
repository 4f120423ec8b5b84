"""Ours and the peers, measured side by side: what scripts/benchmark.py is made of."""
