"""Colours of the pictures, and in what colours a machine is drawn."""

from __future__ import annotations

from typing import NamedTuple

Colour = tuple[int, int, int]

SKY, FAR_HILLS, NEAR_HILLS = (243, 246, 250), (230, 237, 244), (215, 225, 236)
TRACK, FACE, SHADOW, TICKS = (176, 189, 203), (52, 63, 79), (38, 47, 60), (126, 142, 161)
LEG, LEG_LIGHT, STANCE, STANCE_LIGHT = (44, 56, 74), (92, 109, 133), (0, 150, 136), (94, 208, 194)
ROD, ROD_DARK, ROD_LIGHT = (229, 86, 46), (168, 55, 24), (255, 163, 124)
WHITE, TEXT, FAINT = (255, 255, 255), (38, 47, 60), (118, 132, 150)

#: A background that glares neither on a white page nor on a black one.
PAPER = (217, 223, 231)

#: On it: lines and empty bars, and text beside the main thing.
RULE, MUTED = (186, 196, 208), (84, 97, 115)

#: Walkers in one picture: the first, the optimum's ghost, others. Blue and vermilion are told apart
#: by everyone; all are named in the picture.
FIRST, OPTIMUM, OTHERS = (196, 62, 22), (0, 92, 171), ((116, 52, 138), (120, 88, 0))


def blend(a: Colour, b: Colour, share: float) -> Colour:
    """`a` with a share of `b`."""
    red, green, blue = (round(x + share * (y - x)) for x, y in zip(a, b, strict=True))
    return red, green, blue


class Paint(NamedTuple):
    """The colours of a machine.

    Attributes:
        leg, leg_light: of legs in the air, and of the light on them.
        stance, stance_light: of legs that stand, and of the light on them.
        rod, rod_dark, rod_light: of the pendulum, its edge, and the light on it.
    """

    leg: Colour
    leg_light: Colour
    stance: Colour
    stance_light: Colour
    rod: Colour
    rod_dark: Colour
    rod_light: Colour

    @classmethod
    def of_one(cls, colour: Colour) -> Paint:
        """Shades of one colour: for a ghost."""
        light, dark = blend(colour, WHITE, 0.45), blend(colour, LEG, 0.35)
        return cls(colour, light, dark, light, colour, dark, light)


USUAL = Paint(LEG, LEG_LIGHT, STANCE, STANCE_LIGHT, ROD, ROD_DARK, ROD_LIGHT)
