"""The Gymnasium environments, single and natively vectorised, over one fleet of wheels."""
