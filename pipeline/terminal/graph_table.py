"""The graph of a ROS domain as a table."""

from rich.table import Table
from rich.text import Text

from recorders.text.wording import escape_control
from recorders.wire.keys.ros_graph import GraphView


def graph_table(view: GraphView) -> Table:
    """Return a table of topics, one a row, with types and nodes, for 80 columns; all names come from anyone."""
    table = Table(box=None, pad_edge=False, caption_justify="left")
    for name in ("topic", "type", "published by", "subscribed by"):
        table.add_column(name, overflow="fold")
    described = view.to_dict()["topics"]
    for row in described:
        types = [_counted(kind, len(row["hashes"][kind])) for kind in row["types"]]
        table.add_row(*map(_lines, ([row["topic"]], types, row["publishers"], row["subscriptions"])))
    busy = {name for row in described for side in ("publishers", "subscriptions") for name in row[side]}
    if idle := [name for name in view.nodes if name not in busy]:
        table.caption = Text("nodes without topics: " + ", ".join(map(escape_control, idle)))
    return table


def _counted(kind: str, definitions: int) -> str:
    """Return a type, with the number of its definitions if there are several: these nodes do not understand all."""
    return kind if definitions == 1 else f"{kind} ({definitions} definitions)"


def _lines(names: list[str]) -> Text:
    return Text("\n".join(map(escape_control, names)) or "-")
