"""Link to the robot and the controllers over Zenoh: states in, targets out, and what they report of themselves."""

import json
import logging
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self
from uuid import uuid4

import numpy as np

from pipeline.arrays import Floats
from pipeline.browser.session.drive import Drive, Tick
from pipeline.browser.session.keys import controller_topic
from pipeline.robot.telemetry import hand_message
from recorders.cdr.codec import decode_as
from recorders.errors import JointError, ReenactError
from recorders.messages.message_types import Float64MultiArray, JointState
from recorders.messages.phase import LEARN, Phase
from recorders.messages.topics import (
    CONTROLLER_DEVIATION,
    JOINT_STATES,
    SAMPLE_JOINTS,
    SESSION_PHASE,
    hand_target,
    type_of,
)
from recorders.nodes.keys import controller_key
from recorders.text.once import OnceWarner
from recorders.text.wording import escape_control
from recorders.ticks.joiner import JointMap
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import Sample, Session

logger = logging.getLogger(__name__)

_MAX_PAYLOAD = 1 << 16  # anybody may publish [bytes]
_ANSWER_S = 0.5
_SILENT_S = 1.0  # after so long without a state, the robot counts as gone
_MAX_REASONS = 20
_MAX_CONTROLLERS = 20  # whose counts are remembered
_MAX_TEXT = 300


class RobotLink:
    """Answers every state of a robot with a tick, for the controller that is chosen.

    Parameters
    ----------
    session : Session
        An open session.
    drive : Drive
        Makes the ticks.
    keys : TopicKeys
        Keys of the topics, and the namespace.

    Attributes
    ----------
    controller : str
        Name of the controller that gets the targets; empty: whoever serves in the namespace.
    deviations_m : ndarray or None
        How far off each hand may be, as the controller predicted last [m], shape (hands,).
    """

    def __init__(self, session: Session, drive: Drive, *, keys: TopicKeys) -> None:
        self._session, self._drive, self._keys = session, drive, keys
        self._joints = JointMap(drive.robot.joints)
        self._run = uuid4().hex
        self._cycles = 0
        self._warnings = OnceWarner(logger, limit=4)
        self._lock = threading.Lock()
        self._seen_s = -_SILENT_S
        self._over = False
        self._counts: dict[str, int] = {}  # targets that each controller had answered when it was asked last
        self._stack = ExitStack()
        self.controller = ""
        self.deviations_m: Floats | None = None

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._publisher = stack.enter_context(TopicPublisher(self._session, keys=self._keys))
            for topic, take in ((JOINT_STATES, self._on_state), (CONTROLLER_DEVIATION, self._on_deviation)):
                stack.enter_context(self._keys.subscribing(self._session, topic, type_of(topic), take))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            self._over = True  # states that wait on a thread of Zenoh's are still handed over
        self._stack.close()

    @property
    def is_there(self) -> bool:
        """Whether the robot reports its state."""
        return time.monotonic() - self._seen_s < _SILENT_S

    def choose(self, controller: str) -> None:
        """Give the targets to another controller from now on."""
        with self._lock:
            self.controller, self.deviations_m = controller, None

    def controller_status(self) -> dict[str, Any]:
        """Return what the controller that is chosen reports; empty where nobody answers.

        Its `name` if it gives one, how many targets it has `answered`, reasons for what it `refused` with counts, the
        `last_refusal`, and `strange`: those of its joints that the robot does not have, and those that it lacks.

        The drive counts errors while this is called at least each half second, and the controller answers in between:
        commands may have any topic and type.
        """
        asked = self.controller
        key = controller_key(self._keys.namespace, asked or "*", "status")
        for reply in self._session.get(key, timeout=_ANSWER_S):
            if reply.ok is not None and len(reply.ok.payload) <= _MAX_PAYLOAD:
                status = _read_status(reply.ok.payload.to_bytes(), self._drive.robot.joints)
                if status:
                    self._count(asked or status["name"], status["answered"])
                return status
        return {}

    def _count(self, controller: str, answered: int) -> None:
        """Compare a controller's count with that of the last question; a smaller one is of one that was restarted."""
        with self._lock:
            if len(self._counts) >= _MAX_CONTROLLERS and controller not in self._counts:
                self._counts.clear()
            before, self._counts[controller] = self._counts.get(controller), answered
        if answered > 0 and before not in (None, answered):
            self._drive.answer()

    def _on_state(self, sample: Sample) -> None:
        """Take a state: on a thread of Zenoh's."""
        try:
            state = decode_as(JointState, _small(sample))
            q = self._joints.positions(state)
            if not np.isfinite(q).all():
                raise JointError("expected finite joint positions, found NaN or infinity; the state is not used")
            tick = self._drive.take(state.stamp_ns, q)
        except ReenactError as error:
            self._warnings.warn(f"{JOINT_STATES}: {error}", kind=JOINT_STATES)
            return
        self._seen_s = time.monotonic()
        with self._lock:
            if tick is not None and not self._over:
                self._publish(tick, state)

    def _publish(self, tick: Tick, state: JointState) -> None:
        put: Callable[..., object] = self._publisher.publish
        if tick.begins:
            marker = Phase(self._run, 0, self._cycles, LEARN, log="")
            self._cycles += 1
            put(SESSION_PHASE, marker.to_message(), log_time_ns=tick.stamp_ns)
        for hand, row in zip(self._drive.robot.hand_names, tick.rows, strict=True):
            message = hand_message(tick.stamp_ns, row)
            if self.controller:
                put(controller_topic(self.controller, hand), message, log_time_ns=tick.stamp_ns)
            put(hand_target(hand), message, log_time_ns=tick.stamp_ns)
        put(SAMPLE_JOINTS, state, log_time_ns=tick.stamp_ns)

    def _on_deviation(self, sample: Sample) -> None:
        try:
            found = decode_as(Float64MultiArray, _small(sample)).data
        except ReenactError as error:
            self._warnings.warn(f"{CONTROLLER_DEVIATION}: {error}", kind=CONTROLLER_DEVIATION)
            return
        if len(found) == len(self._drive.robot.hands) and np.isfinite(found).all():
            self.deviations_m = found


def _small(sample: Sample) -> bytes:
    return sample.payload.to_bytes() if len(sample.payload) <= _MAX_PAYLOAD else b""


def _read_status(data: bytes, joints: Sequence[str]) -> dict[str, Any]:
    """Return what is of use of a status from whoever answered."""
    try:
        found = json.loads(data)
        refused = {str(reason)[:_MAX_TEXT]: int(count) for reason, count in dict(found.get("refused", {})).items()}
        answered, last = int(found.get("accepted", 0)), escape_control(str(found.get("last_refusal", ""))[:_MAX_TEXT])
        name = escape_control(str(found.get("name", ""))[:_MAX_TEXT])
        commanded = {escape_control(str(joint)[:_MAX_TEXT]) for joint in list(found.get("joints", joints))}
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        return {}
    return {
        "name": name,
        "answered": answered,
        "refused": dict(list(refused.items())[:_MAX_REASONS]),
        "last_refusal": last,
        "strange": sorted(commanded ^ set(joints)),
    }
