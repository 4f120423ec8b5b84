"""The study that chooses the preset BUILDABLE: catalogue parts, mass budget, gaits, start-up."""
