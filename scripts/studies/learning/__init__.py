"""Every learner over several seeds, each seed trained and evaluated alike."""
