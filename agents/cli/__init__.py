"""The command line: what a user types after `rimless`."""
