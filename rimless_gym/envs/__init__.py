"""The Gymnasium environments, single and natively vectorised, over one fleet of wheels."""

#: Length of an episode under the registered time limit.
EPISODE_STEPS = 2000
