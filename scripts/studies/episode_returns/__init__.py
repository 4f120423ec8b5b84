"""What an episode pays: the returns of default episodes, whoever walks."""
