"""The nodes of a namespace as a table."""

from collections.abc import Iterator, Sequence

from rich.table import Table
from rich.text import Text

from recorders.nodes.status import NodeStatus
from recorders.text.wording import escape_control

_DIGITS = 8  # of a digest, enough to distinguish it from another
_MINUTE_S, _HOUR_S = 60, 3600


def status_table(nodes: Sequence[NodeStatus]) -> Table:
    """Return a table of nodes, one a row, for 80 columns; their texts come from anyone and are escaped."""
    table = Table(box=None, pad_edge=False)
    for name in ("kind", "name", "state", "since", "figures"):
        table.add_column(name, overflow="fold")
    for node in nodes:
        cells = (
            node.kind,
            node.name,
            node.state,
            "-" if node.since_s is None else duration(node.since_s),
            "\n".join(f"{name.replace(chr(10), ' ')} {figure}" for name, figure in _figures(node)),
        )
        table.add_row(*(Text("\n".join(escape_control(line) for line in cell.split("\n"))) for cell in cells))
    return table


def _figures(node: NodeStatus) -> Iterator[tuple[str, str]]:
    """Yield name and figure: counts, each with its rate of late where there is one, latencies, digests."""
    for name, count in node.counts.items():
        if count:
            rate = node.rates_hz.get(name)
            yield name, f"{count} ({rate:.1f} a second)" if rate else str(count)
    for name, latency_us in node.latency_us.items():
        if latency_us is not None:
            yield name, f"{latency_us:.0f} us"
    for name, digest in node.digests.items():
        yield "digest" if name == node.kind else f"{name} digest", digest[:_DIGITS]


def duration(seconds: float) -> str:
    """Return a time such as 5 s, 12 min 5 s or 3 h 12 min."""
    whole = max(0, int(seconds))
    if whole < _MINUTE_S:
        return f"{whole} s"
    if whole < _HOUR_S:
        return f"{whole // _MINUTE_S} min {whole % _MINUTE_S} s"
    return f"{whole // _HOUR_S} h {whole % _HOUR_S // _MINUTE_S} min"
