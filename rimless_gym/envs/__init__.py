"""The Gymnasium environments, single and natively vectorised, over one batch of wheels."""

#: Length of an episode, 20 s, under the registered time limits: in steps of 10 ms, and of 40 ms.
EPISODE_STEPS, SPEED_EPISODE_STEPS = 2000, 500

#: Mean return of an episode (m) from which a policy counts as having solved the task: two thirds of
#: what the front's best gait would return if it were walked for all 20 s. `scripts.studies returns`
#: measures both; docs/environment.md has the table.
REWARD_THRESHOLD, SPEED_REWARD_THRESHOLD = 3.9, 32.0
