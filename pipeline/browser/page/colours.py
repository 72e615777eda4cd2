"""Colours that people with any colour vision distinguish, on dark pages and on light ones."""

from typing import TypeAlias

Colour: TypeAlias = tuple[int, int, int]

# Okabe and Ito, "Color Universal Design", 2008.
_HANDS: tuple[Colour, ...] = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167))
ASKED: Colour = (140, 140, 140)
"""Of what is asked for."""


def hand_colour(place: int) -> Colour:
    """Return the colour of a hand by its place among those of the robot."""
    return _HANDS[place % len(_HANDS)]


def css(colour: Colour) -> str:
    """Return a colour as a style sheet has it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
