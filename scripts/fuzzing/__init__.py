"""The compiled environment on random machines, under random voltages, checked at every step."""
