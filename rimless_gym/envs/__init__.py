"""The Gymnasium environments, single and natively vectorised, over one fleet of wheels."""

#: Length of an episode, 20 s, under the registered time limits: in steps of 10 ms, and of 40 ms.
EPISODE_STEPS, SPEED_EPISODE_STEPS = 2000, 500
