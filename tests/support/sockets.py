"""What a process listens on, as the kernel tells it."""

from pathlib import Path


def listening(pid: int) -> set[str]:
    """Addresses on which a process listens over TCP, and those of its UDP sockets."""
    sockets = {
        Path(entry).readlink().name.removeprefix("socket:[").removesuffix("]")
        for entry in Path(f"/proc/{pid}/fd").iterdir()
        if Path(entry).is_symlink() and str(Path(entry).readlink()).startswith("socket:[")
    }
    found = set()
    for table, states in (("tcp", {"0A"}), ("tcp6", {"0A"}), ("udp", {"07"}), ("udp6", {"07"})):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in sockets and fields[3] in states:
                found.add(f"{table} {fields[1]}")
    return found


def loopback(endpoint: str) -> str:
    """Return how `listening` names an endpoint on 127.0.0.1."""
    return f"tcp 0100007F:{int(endpoint.rpartition(':')[2]):04X}"
