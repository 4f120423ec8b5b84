"""A fuzz: the compiled environment on random machines under random voltages, every step checked."""
