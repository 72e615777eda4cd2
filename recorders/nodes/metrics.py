"""The status of a node for Prometheus, on loopback alone."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from recorders.errors import ConfigError, install_text
from recorders.nodes.status import NodeMeter

if TYPE_CHECKING:
    from prometheus_client.metrics_core import Metric

_HOST = "127.0.0.1"
_TAKEN = "--prometheus: expected a free port of 127.0.0.1, found {}: {}; choose another"
_MISSING = f"--prometheus: expected the package prometheus-client, found none; {install_text('metrics')}"


def check_metrics(port: int | None) -> None:
    """Check, before anything is begun, that metrics can be served if they are asked for.

    Raises
    ------
    ConfigError
        If prometheus-client is not installed, or the port is in use.
    """
    if port is None:
        return
    try:
        import prometheus_client  # noqa: F401, PLC0415  # an extra, for those who ask

        socket.create_server((_HOST, port)).close()
    except ImportError as error:
        raise ConfigError(_MISSING) from error
    except OSError as error:
        raise ConfigError(_TAKEN.format(port, os.strerror(error.errno or 0))) from error


@contextmanager
def metrics_served(meter: NodeMeter, port: int | None) -> Iterator[None]:
    """Serve the figures of a node's status over HTTP while the block runs; nothing if there is no port.

    Parameters
    ----------
    meter : NodeMeter
        The node's.
    port : int or None
        Port on 127.0.0.1.

    Raises
    ------
    ConfigError
        If the port is in use.
    """
    if port is None:
        yield
        return
    from prometheus_client import CollectorRegistry, start_http_server  # noqa: PLC0415

    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Figures(meter))
    try:
        server, thread = start_http_server(port, addr=_HOST, registry=registry)
    except OSError as error:
        raise ConfigError(_TAKEN.format(port, os.strerror(error.errno or 0))) from error
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Figures:
    """Collects the figures of a status as metrics."""

    def __init__(self, meter: NodeMeter) -> None:
        self._meter = meter

    def collect(self) -> "Iterator[Metric]":
        """Yield the metrics of now."""
        from prometheus_client.core import (  # noqa: PLC0415
            CounterMetricFamily,
            GaugeMetricFamily,
            InfoMetricFamily,
        )

        status = self._meter.status()
        node, who = ["kind", "name"], [status.kind, status.name]
        info = InfoMetricFamily("reenact_node", "State of the node.", labels=node)
        info.add_metric(who, {"state": status.state})
        since = GaugeMetricFamily("reenact_since_seconds", "How long the node has been there.", labels=node)
        since.add_metric(who, status.since_s or 0.0)
        counts = CounterMetricFamily("reenact_count", "What the node has counted.", labels=[*node, "what"])
        rates = GaugeMetricFamily("reenact_rate_hertz", "How fast the counts grow.", labels=[*node, "what"])
        latencies = GaugeMetricFamily("reenact_latency_us", "Latencies of late.", labels=[*node, "percentile"])
        digests = InfoMetricFamily("reenact_digest", "Digests by name.", labels=[*node, "what"])
        for name, count in status.counts.items():
            counts.add_metric([*who, name], count)
        for name, rate in status.rates_hz.items():
            rates.add_metric([*who, name], rate)
        for name, latency in status.latency_us.items():
            if latency is not None:
                latencies.add_metric([*who, name], latency)
        for name, digest in status.digests.items():
            digests.add_metric([*who, name], {"digest": digest})
        yield from (info, since, counts, rates, latencies, digests)
