"""The wire: the one place that opens Zenoh sessions, and the protocol that carries a stream of messages over them.

A *sender* (the replay) and its *consumers* (a learner, a recorder) meet under one namespace:

- `NAMESPACE/hand/left/target` and so on: one message on the key of its topic, described by its attachment.
- `NAMESPACE/replay/batch`: several messages, packed unchanged into one payload.
- `NAMESPACE/@replay/SENDER/channels`: types and schemas of what a replay plays; published, and a query for who is late.
- `NAMESPACE/@consumer/NAME/hello`: a query; the consumer answers with the index it wants next, or refuses.
- `NAMESPACE/@consumer/NAME/status`: a query; how far the consumer has come. Ends with the sender's farewell.
- `NAMESPACE/@consumer/NAME/ack`: published by the consumer; everything before `next` has been consumed.

In a ROS domain the messages are on the keys of rmw_zenoh instead, `DOMAIN/hand/left/target/TYPE/HASH` and so on, and
all the rest stays where it is; `recorders.wire.keys` has both mappings.

Zenoh's wildcards never match a chunk that begins with `@`, so a consumer's one subscriber on `NAMESPACE/**` sees
the data alone.
"""
