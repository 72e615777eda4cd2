"""Topics on which each controller gets the targets that it is to answer, while several of them stand ready."""

from collections.abc import Sequence

from recorders.messages.topics import hand_target

LED = "/lead"
"""First part of these topics; a recording leaves them out, as they repeat the targets."""


def controller_topic(controller: str, hand: str) -> str:
    """Return the topic of a hand's target for one controller alone."""
    return f"{LED}/{controller}{hand_target(hand)}"


def renamed_targets(controller: str, hands: Sequence[str]) -> list[str]:
    """Return the arguments by which `serve` takes its targets from there."""
    return [part for hand in hands for part in ("--map", f"{controller_topic(controller, hand)}={hand_target(hand)}")]
