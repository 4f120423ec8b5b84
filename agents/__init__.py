"""Learning to walk: training, imitation of the optimal gait, and the evaluation protocol."""
