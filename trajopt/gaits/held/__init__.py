"""Periodic gaits whose voltage is held over every interval of a clock."""
