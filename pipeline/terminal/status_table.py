"""The nodes of a namespace as a table."""

from collections.abc import Mapping, Sequence

from rich.table import Table
from rich.text import Text

from recorders.nodes.status import NodeStatus
from recorders.text.wording import escape_control

_DIGITS = 12  # of a digest, which tell one from another
_MINUTE_S, _HOUR_S = 60, 3600


def status_table(nodes: Sequence[NodeStatus]) -> Table:
    """Return a table of nodes, one a row; their texts come from anyone and are escaped."""
    table = Table(box=None, pad_edge=False)
    for name in ("kind", "name", "state", "since", "counts", "Hz", "us", "digests"):
        table.add_column(name, overflow="fold")
    for node in nodes:
        cells = (
            node.kind,
            node.name,
            node.state,
            "-" if node.since_s is None else duration(node.since_s),
            _listed({name: str(count) for name, count in node.counts.items() if count}),
            _listed({name: f"{rate:.1f}" for name, rate in node.rates_hz.items() if rate}),
            _listed({name: f"{value:.0f}" for name, value in node.latency_us.items() if value is not None}),
            _listed({name: digest[:_DIGITS] for name, digest in node.digests.items()}),
        )
        table.add_row(*(Text("\n".join(escape_control(line) for line in cell.split("\n"))) for cell in cells))
    return table


def duration(seconds: float) -> str:
    """Return a time such as 5 s, 12 min 5 s or 3 h 12 min."""
    whole = max(0, int(seconds))
    if whole < _MINUTE_S:
        return f"{whole} s"
    if whole < _HOUR_S:
        return f"{whole // _MINUTE_S} min {whole % _MINUTE_S} s"
    return f"{whole // _HOUR_S} h {whole % _HOUR_S // _MINUTE_S} min"


def _listed(entries: Mapping[str, str]) -> str:
    return "\n".join(f"{name.replace(chr(10), ' ')} {value}" for name, value in entries.items())
