"""The protocol that carries a stream from a sender to its consumers: two machines without I/O, driven from outside.

Nothing here knows Zenoh, threads, sleeping or a clock: events come in with the time at which they happen, what is to be
sent and the next deadline go out. `recorders.wire` drives both ends over Zenoh.
"""
