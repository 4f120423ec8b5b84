"""rimless-gym: energy-efficient walking with the simplest walker there is."""

from rimless_gym.params import PROTOTYPE, THESIS_NOMINAL, THESIS_PHYSICAL, WheelParams

__all__ = ["PROTOTYPE", "THESIS_NOMINAL", "THESIS_PHYSICAL", "WheelParams"]
