"""The catch: what brings the wheel to a gait from rest, and from anywhere else."""
