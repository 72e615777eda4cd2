"""A free endpoint is for whom it was found: others that ask for any find another."""

import socket

from recorders.wire.loopback import free_endpoint


def test_nobody_is_given_the_same_endpoint_and_whoever_was_may_listen_there() -> None:
    endpoints = [free_endpoint() for _ in range(500)]
    assert len(set(endpoints)) == len(endpoints)  # by chance alone, nine or so would be there twice
    for endpoint in endpoints[::100]:
        host, port = endpoint.removeprefix("tcp/").split(":")
        with socket.create_server((host, int(port))), socket.create_connection((host, int(port))):
            pass
