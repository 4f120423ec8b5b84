"""The Gymnasium environments, single and natively vectorised, over one batch of wheels."""

#: Length of an episode, 20 s, under the registered time limits: in steps of 10 ms, and of 40 ms.
EPISODE_STEPS, SPEED_EPISODE_STEPS = 2000, 500

#: Mean return of an episode (m) from which a policy counts as having solved the task: that of a
#: walk that costs a quarter more than the front, 20 s * v (0.5 - 1.25 CoT) = 5.68 m at the speed of
#: the best gait, 20 s * v (5 - 1.25 CoT) = 47.5 m on average over the commands, times the share of
#: the front's return that a start-up from rest leaves: the LQR's, 4.65 / 5.82, and that of the
#: policy `front`, 53.5 / 56.7. `scripts.studies returns` measures these; docs/environment.md has
#: the tables.
REWARD_THRESHOLD, SPEED_REWARD_THRESHOLD = 4.5, 45.0
