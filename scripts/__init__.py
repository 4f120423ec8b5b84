"""What is run from a checkout; not installed."""
