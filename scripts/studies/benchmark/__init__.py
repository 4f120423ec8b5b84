"""Speed, ours and the peers'."""
