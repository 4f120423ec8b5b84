"""Every feedback law about several held gaits, measured alike."""
