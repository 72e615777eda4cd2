"""States of both ends of a stream, and the events that lead from one to the next; there are no others."""

from enum import Enum


class SenderState(Enum):
    """Where a sender is on its way."""

    GREETING = "greeting"  # offers the stream to one consumer after the other
    SENDING = "sending"
    ENDING = "ending"  # all is sent; results are awaited
    LEAVING = "leaving"  # says farewell, so that the consumers wait no longer
    DONE = "done"
    FAILED = "failed"  # the consumers learn why by an ABORT, as far as the connection allows


class ReceiverState(Enum):
    """Where a receiver is with the stream under way."""

    IDLE = "idle"  # no stream: an offer is welcome
    RECEIVING = "receiving"
    REPORTED = "reported"  # the result is there, for the sender to fetch
    FAILED = "failed"  # the consumer gave up, which the sender is still to learn
    LOST = "lost"  # the sender gave up or is gone, which the consumer is still to learn


SENDER_TRANSITIONS = {
    (SenderState.GREETING, "greeted"): SenderState.SENDING,
    (SenderState.GREETING, "consumer restarted"): SenderState.GREETING,
    (SenderState.SENDING, "consumer restarted"): SenderState.GREETING,
    (SenderState.ENDING, "consumer restarted"): SenderState.GREETING,
    (SenderState.SENDING, "rewound"): SenderState.SENDING,
    (SenderState.ENDING, "rewound"): SenderState.SENDING,
    (SenderState.SENDING, "ended"): SenderState.ENDING,
    (SenderState.ENDING, "all reported"): SenderState.LEAVING,
    (SenderState.LEAVING, "all know"): SenderState.DONE,
    (SenderState.GREETING, "failed"): SenderState.FAILED,
    (SenderState.SENDING, "failed"): SenderState.FAILED,
    (SenderState.ENDING, "failed"): SenderState.FAILED,
    (SenderState.LEAVING, "failed"): SenderState.FAILED,
}
"""The next state of a sender by state and event."""

RECEIVER_TRANSITIONS = {
    (ReceiverState.IDLE, "accepted"): ReceiverState.RECEIVING,
    (ReceiverState.RECEIVING, "finished"): ReceiverState.REPORTED,
    (ReceiverState.RECEIVING, "failed"): ReceiverState.FAILED,
    (ReceiverState.RECEIVING, "sender aborted"): ReceiverState.LOST,
    (ReceiverState.RECEIVING, "sender silent"): ReceiverState.LOST,
    (ReceiverState.RECEIVING, "abandoned"): ReceiverState.IDLE,
    (ReceiverState.REPORTED, "fetched"): ReceiverState.IDLE,
    (ReceiverState.REPORTED, "sender aborted"): ReceiverState.IDLE,
    (ReceiverState.REPORTED, "sender silent"): ReceiverState.IDLE,
    (ReceiverState.REPORTED, "abandoned"): ReceiverState.IDLE,
    (ReceiverState.REPORTED, "finished"): ReceiverState.REPORTED,
    (ReceiverState.REPORTED, "failed"): ReceiverState.FAILED,
    (ReceiverState.FAILED, "fetched"): ReceiverState.IDLE,
    (ReceiverState.FAILED, "sender aborted"): ReceiverState.IDLE,
    (ReceiverState.FAILED, "sender silent"): ReceiverState.IDLE,
    (ReceiverState.FAILED, "abandoned"): ReceiverState.IDLE,
    (ReceiverState.FAILED, "failed"): ReceiverState.FAILED,
    (ReceiverState.LOST, "finished"): ReceiverState.IDLE,
    (ReceiverState.LOST, "failed"): ReceiverState.IDLE,
    (ReceiverState.LOST, "abandoned"): ReceiverState.IDLE,
}
"""The next state of a receiver by state and event."""
