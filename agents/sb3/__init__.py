"""stable-baselines3: its view of the environments, and what learners built on it share."""
