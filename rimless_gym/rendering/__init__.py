"""Pictures of the wheel: drawn without a display, shown in a window, saved as an animation."""
