"""What is particular to stable-baselines3: its environments, and learners built on its algorithms."""
