"""stable-baselines3: its view of the environments, and what learners built on it share."""

from rimless_gym.checks import extra

with extra("learn"):
    import stable_baselines3  # noqa: F401
    import torch  # noqa: F401
