"""Draws the states of both ends of a stream into the guide, from the tables by which the machines move.

`python data/pictures/states.py` renews the diagrams (Mermaid) in `data/guides/protocol.md`; `make test` fails where
they are not those of the machines.
"""

import re
import sys
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "data" / "guides" / "protocol.md"
sys.path.insert(0, str(ROOT))

from recorders.protocol.states import RECEIVER_TRANSITIONS, SENDER_TRANSITIONS, ReceiverState, SenderState  # noqa: E402

_ENDS = (SenderState.DONE, SenderState.FAILED)


def diagram(first: Enum, transitions: Mapping[Any, Enum]) -> str:
    """Return the diagram of a machine: its events on the arrows, those between the same states on one."""
    arrows: dict[tuple[Enum, Enum], list[str]] = {}
    for (state, event), after in transitions.items():
        arrows.setdefault((state, after), []).append(event)
    lines = [f"    [*] --> {first.value}"]
    lines += [f"    {state.value} --> {after.value}: {', '.join(events)}" for (state, after), events in arrows.items()]
    lines += [f"    {state.value} --> [*]" for state in type(first) if state in _ENDS]
    return "\n".join(["```mermaid", "stateDiagram-v2", *lines, "```"])


def renewed(text: str) -> str:
    """Return the guide with the diagrams of the machines as they are."""
    diagrams = {
        "sender": diagram(SenderState.GREETING, SENDER_TRANSITIONS),
        "receiver": diagram(ReceiverState.IDLE, RECEIVER_TRANSITIONS),
    }
    for name, drawn in diagrams.items():
        block = re.compile(rf"(<!-- states of the {name} -->\n).*?(\n<!-- end -->)", re.DOTALL)
        if not block.search(text):
            raise SystemExit(f"{GUIDE}: no place for the states of the {name}")
        text = block.sub(lambda found, drawn=drawn: found[1] + drawn + found[2], text)  # type: ignore[misc]
    return text


if __name__ == "__main__":
    GUIDE.write_text(renewed(GUIDE.read_text()))
