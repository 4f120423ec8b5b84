"""The speed of this package and of its peers, measured side by side."""
