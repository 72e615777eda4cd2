"""Runs what is done with logs, each in a fork of its own, and prints how much memory each took; run as a program."""

import json
import os
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

from recorders.errors import ReenactError
from recorders.reading.reader import LogReader
from recorders.recovery.log_info import summarise
from recorders.recovery.recover import recover


def read(path: str) -> object:
    """Read every message; returns how many there are."""
    return sum(1 for _ in LogReader(path))


def read_topic(path: str) -> object:
    """Read the messages of one topic; returns how many there are."""
    return sum(1 for _ in LogReader(path).records(topics=["/sound/1"]))


def info(path: str) -> object:
    """Return what `info` finds."""
    found = summarise(path).to_dict()
    return {
        "messages": found["messages"],
        "sound": found["sound"],
        "damage": [each["reason"] for each in found["damage"]],
    }


def recovered(path: str) -> object:
    """Return what `recover` finds, and what is in what it wrote."""
    with tempfile.TemporaryDirectory() as folder:
        found = recover(path, Path(folder, "out.mcap")).to_dict()
        again = LogReader(Path(folder, "out.mcap"))
        names = list(again.attachments)
        return {
            "kept": found["kept"],
            "complete": found["complete"],
            "again": sum(again.counts.values()),
            "names": names,
        }


DONE = {"read": read, "read_topic": read_topic, "info": info, "recover": recovered}


def _in_child(what: str, path: str, write: int) -> None:
    try:
        result = DONE[what](path)
    except ReenactError as error:
        result = f"{type(error).__name__}: {error}"
    except BaseException:
        result = traceback.format_exc()
    os.write(write, json.dumps(result).encode())
    os.close(write)
    os._exit(0)


def peak(what: str, path: str) -> tuple[Any, int]:
    """Do one thing with one log in a fork; returns its result and the most memory that it had at once [bytes]."""
    read_end, write_end = os.pipe()
    child = os.fork()
    if not child:
        _in_child(what, path, write_end)
    os.close(write_end)
    with os.fdopen(read_end, "rb") as pipe:
        result = json.loads(pipe.read() or b'"killed"')
    return result, os.wait4(child, 0)[2].ru_maxrss * 1024


if __name__ == "__main__":
    print(json.dumps([peak(*each.split(":", 1)) for each in sys.argv[1:]]))
