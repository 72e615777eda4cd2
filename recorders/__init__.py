"""The log: message types, codec, topics, MCAP writer and reader, and the wire they travel on."""

import logging
from typing import TYPE_CHECKING

from recorders.lazy import lazy_names

if TYPE_CHECKING:
    from recorders.cdr.codec import decode as decode
    from recorders.cdr.codec import decode_as as decode_as
    from recorders.cdr.codec import encode as encode
    from recorders.cdr.message_format import MessageFormat as MessageFormat
    from recorders.containers.opening import open_log as open_log
    from recorders.errors import ReenactError as ReenactError
    from recorders.messages.message_types import Clock as Clock
    from recorders.messages.message_types import Float64MultiArray as Float64MultiArray
    from recorders.messages.message_types import JointState as JointState
    from recorders.messages.message_types import Message as Message
    from recorders.messages.message_types import PoseStamped as PoseStamped
    from recorders.messages.message_types import String as String
    from recorders.messages.message_types import TFMessage as TFMessage
    from recorders.messages.message_types import TransformStamped as TransformStamped
    from recorders.messages.message_types import TypedMessage as TypedMessage
    from recorders.messages.phase import Phase as Phase
    from recorders.messages.record import RecordedMessage as RecordedMessage
    from recorders.messages.topics import TOPICS as TOPICS
    from recorders.messages.topics import Topic as Topic
    from recorders.messages.topics import type_of as type_of
    from recorders.protocol.stream import Consumer as Consumer
    from recorders.protocol.stream import Offer as Offer
    from recorders.protocol.stream import Progress as Progress
    from recorders.reading.reader import LogReader as LogReader
    from recorders.reading.session_reader import SessionReader as SessionReader
    from recorders.recording.live_recorder import LiveRecorder as LiveRecorder
    from recorders.recovery.log_info import LogSummary as LogSummary
    from recorders.recovery.log_info import summarise as summarise
    from recorders.recovery.recover import Recovery as Recovery
    from recorders.recovery.recover import recover as recover
    from recorders.ticks.joiner import JointMap as JointMap
    from recorders.ticks.joiner import Tick as Tick
    from recorders.ticks.joiner import TickJoiner as TickJoiner
    from recorders.ticks.joiner import join_ticks as join_ticks
    from recorders.wire.receiver import Receiver as Receiver
    from recorders.wire.receiver import ReceiverConfig as ReceiverConfig
    from recorders.wire.session import SessionConfig as SessionConfig
    from recorders.wire.session import open_session as open_session
    from recorders.writing.writer import LogWriter as LogWriter

_HOMES = {
    "recorders.cdr.message_format": ("MessageFormat",),
    "recorders.cdr.codec": ("decode", "decode_as", "encode"),
    "recorders.errors": ("ReenactError",),
    "recorders.messages.message_types": (
        "Clock",
        "Float64MultiArray",
        "JointState",
        "Message",
        "PoseStamped",
        "String",
        "TFMessage",
        "TransformStamped",
        "TypedMessage",
    ),
    "recorders.messages.phase": ("Phase",),
    "recorders.messages.record": ("RecordedMessage",),
    "recorders.messages.topics": ("TOPICS", "Topic", "type_of"),
    "recorders.reading.reader": ("LogReader",),
    "recorders.containers.opening": ("open_log",),
    "recorders.reading.session_reader": ("SessionReader",),
    "recorders.recording.live_recorder": ("LiveRecorder",),
    "recorders.recovery.log_info": ("LogSummary", "summarise"),
    "recorders.recovery.recover": ("Recovery", "recover"),
    "recorders.ticks.joiner": ("JointMap", "Tick", "TickJoiner", "join_ticks"),
    "recorders.wire.receiver": ("Receiver", "ReceiverConfig"),
    "recorders.wire.session": ("SessionConfig", "open_session"),
    "recorders.protocol.stream": ("Consumer", "Offer", "Progress"),
    "recorders.writing.writer": ("LogWriter",),
}
"""Public names by the module that each is imported from when it is asked for."""

__all__, _get, _every = lazy_names(__name__, _HOMES)

if not TYPE_CHECKING:  # where types are checked, a name that there is not stays an error
    __getattr__, __dir__ = _get, _every

logging.getLogger(__name__).addHandler(logging.NullHandler())
