"""Publisher of a learner: digests, status, errors, and its outputs while anyone subscribes."""

import json
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

import numpy as np

from pipeline.training.run import CycleReport, Steps
from recorders.cdr.codec import encode
from recorders.messages.message_types import Float64MultiArray, String
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEARNER_DIGEST, LEARNER_ERROR, LEARNER_OUTPUT, LEARNER_STATUS
from recorders.protocol.frames import NO_RUN, Frame, FrameType, pack
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import LOSSY, Session, has_subscribers

_M_PER_CM = 0.01


class LearnerPublisher:
    """Publisher of a learner on Zenoh.

    Outputs are many: they are published while anyone subscribes, and dropped where the network is blocked, as a
    subscriber that stalls must not hold up the learner.

    Parameters
    ----------
    session : Session
        An open session.
    keys : TopicKeys
        Keys of the topics.

    Attributes
    ----------
    digests : dict of str to str
        State and stream digest, as reported last.
    """

    def __init__(self, session: Session, *, keys: TopicKeys) -> None:
        self._session = session
        self._keys = keys
        self._producer = TopicPublisher(session, keys=keys)
        self._outputs_sent = 0
        self._stack = ExitStack()
        self.digests: dict[str, str] = {}

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self._producer)
            self._outputs = stack.enter_context(
                self._keys.publishing(
                    self._session,
                    LEARNER_OUTPUT,
                    Float64MultiArray.TYPE,
                    encoding=f"application/cdr;{Float64MultiArray.TYPE}",
                    **LOSSY,
                )
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def report(self, report: CycleReport, **counts: Any) -> None:
        """Publish the result of a cycle, with further counts in its status."""
        where = {"epoch": report.epoch, "cycle": report.cycle, "phase": report.phase}
        digests = self.digests = {"state": report.digest, "stream": report.stream_digest}
        publish: Callable[..., RecordedMessage] = self._producer.publish
        publish(LEARNER_DIGEST, String(json.dumps(where | digests)), log_time_ns=report.time_ns)
        status = where | {"ticks": report.ticks} | counts
        publish(LEARNER_STATUS, String(json.dumps(status)), log_time_ns=report.time_ns)
        if report.hands_cm is not None:
            errors = Float64MultiArray(np.array(report.hands_cm) * _M_PER_CM)
            publish(LEARNER_ERROR, errors, log_time_ns=report.time_ns)

    def show(self, steps: Steps) -> None:
        """Publish the outputs of some steps, one message each, in the network's order and stamped as its target."""
        if not has_subscribers(self._outputs):
            return
        for stamp_ns, outputs in zip(steps.stamps_ns, steps.outputs, strict=True):
            data = encode(Float64MultiArray(outputs))
            record = RecordedMessage(LEARNER_OUTPUT, Float64MultiArray.TYPE, data, self._outputs_sent, stamp_ns)
            frame = Frame(FrameType.MESSAGE, NO_RUN, self._producer.identity, self._outputs_sent, (record,))
            payload, attachment = pack(frame)
            self._outputs.put(payload, attachment=attachment)
            self._outputs_sent += 1
