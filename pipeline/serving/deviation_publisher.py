"""Publishes the predicted deviations of commands, on the thread of the background writer."""

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial

import zenoh

from pipeline.arrays import Floats
from pipeline.serving.background_writer import BackgroundWriter
from pipeline.serving.topics import CDR
from recorders.cdr.codec import encode
from recorders.messages.message_types import Float64MultiArray
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import CONTROLLER_DEVIATION
from recorders.protocol.frames import live_attachment
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.publisher import new_identity


class DeviationPublisher:
    """Publishes, and records, deviations in the order of their commands.

    Parameters
    ----------
    writer : BackgroundWriter
        On its thread all is done.

    Attributes
    ----------
    identity : bytes
        What distinguishes the controller's numbers from those of others.
    """

    def __init__(self, writer: BackgroundWriter) -> None:
        self._writer = writer
        self._count = 0
        self.identity = new_identity()

    @contextmanager
    def declared(self, session: zenoh.Session, keys: TopicKeys) -> Iterator[None]:
        """Declare the topic while the block runs; what was handed in by its end is published."""
        with keys.publishing(
            session,
            CONTROLLER_DEVIATION,
            Float64MultiArray.TYPE,
            encoding=f"{CDR}{Float64MultiArray.TYPE}",
            congestion_control=zenoh.CongestionControl.DROP,
        ) as self._publisher:
            yield
            self._writer.flush()

    def hand_in(self, stamp_ns: int, deviations: Floats) -> None:
        """Have the deviation of each hand [m] published, under the stamp of its command [ns]."""
        self._writer.do(partial(self._publish, stamp_ns, deviations))

    def _publish(self, stamp_ns: int, deviations: Floats) -> None:
        data = encode(Float64MultiArray(deviations))
        with suppress(zenoh.ZError):  # the way out is closed: so are those of commands
            self._publisher.put(data, attachment=live_attachment(self._count, stamp_ns, self.identity))
        if self._writer.records:
            self._writer.write(
                RecordedMessage(CONTROLLER_DEVIATION, Float64MultiArray.TYPE, data, self._count, time.time_ns())
            )
        self._count += 1
