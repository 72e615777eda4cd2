"""The time of `/clock`: messages arrive at it where asked, and none before there is one."""

import logging

import pytest
import zenoh
from waiting import wait_until

from recorders.cdr.codec import encode
from recorders.messages.message_types import Clock, String
from recorders.messages.topics import CLOCK
from recorders.rmw_zenoh.attachment import Attachment
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from recorders.wire.sim_time import SimTime
from recorders.wire.subscription import LiveMessage


def test_the_time_is_that_of_the_last_message_and_others_change_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    now = SimTime()
    assert not now.is_known
    now.take(encode(Clock(0)))
    assert (now.is_known, now.time_ns()) == (True, 0)
    now.take(encode(Clock(7)))
    with caplog.at_level(logging.WARNING):
        now.take(b"noon")
        now.take(encode(Clock(1))[:-1])
    assert now.time_ns() == 7
    assert len(caplog.messages) == 1


def test_messages_of_chosen_topics_arrive_at_the_time_of_the_domain() -> None:
    endpoint, keys = free_endpoint(), RosKeys(2, NodeName("learner"))
    config = ReceiverConfig(keys=keys, live=True, topics={"/chatter": String.TYPE}, use_sim_time=True)
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        Receiver(session, config=config) as receiver,
        open_session(SessionConfig(connect=(endpoint,))) as other,
    ):
        put(other, keys, "/chatter", String("early"))
        wait_until(lambda: receiver.refused == {"/chatter: before the first message of /clock": 1})
        for topic, message in ((CLOCK, Clock(500)), ("/chatter", String("a"))):
            put(other, keys, topic, message)
            event = receiver.next_event(120.0)
            assert isinstance(event, LiveMessage)
            assert (event.record.topic, event.record.log_time_ns) == (topic, 500)


def put(session: zenoh.Session, keys: RosKeys, topic: str, message: String | Clock) -> None:
    session.put(keys.key(topic, message.TYPE), encode(message), attachment=Attachment(1, 1, bytes(16)).pack())
