"""Learners that publish beside one another: whoever receives it knows what is missing of each."""

from collections import defaultdict

import numpy as np
from waiting import wait_until

from pipeline.learner_node.publisher import LearnerPublisher
from pipeline.training.run import Steps
from recorders.messages.topics import LEARNER_OUTPUT
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, has_subscribers, open_session
from recorders.wire.subscription import LiveMessage


def test_the_outputs_of_each_learner_have_numbers_of_their_own() -> None:
    endpoint, keys = free_endpoint(), NamespaceKeys()
    steps = Steps([0, 1, 2], np.zeros((3, 1)), np.zeros((3, 6)))
    numbers: defaultdict[bytes, list[int]] = defaultdict(list)

    def all_came() -> bool:
        event = receiver.next_event(0.1)
        if isinstance(event, LiveMessage) and event.record.topic == LEARNER_OUTPUT:
            numbers[event.sender].append(event.record.sequence)
        return sum(map(len, numbers.values())) == 9

    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        open_session(SessionConfig(connect=(endpoint,))) as elsewhere,
        Receiver(session, config=ReceiverConfig(live=True, keys=keys)) as receiver,
        LearnerPublisher(elsewhere, keys=keys) as one,
        LearnerPublisher(elsewhere, keys=keys) as other,
    ):
        wait_until(lambda: has_subscribers(one._outputs) and has_subscribers(other._outputs))
        for publisher in (one, other, one):
            publisher.show(steps)
        wait_until(all_came)
    assert sorted(numbers.values()) == [[0, 1, 2], [0, 1, 2, 3, 4, 5]]
