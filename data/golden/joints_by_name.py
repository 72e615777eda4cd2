"""Writes a log again with its joints in the order of the alphabet: python joints_by_name.py LOG.mcap OUT.mcap."""

import sys
from pathlib import Path

from recorders.cdr.codec import decode
from recorders.messages.message_types import JointState
from recorders.reading.reader import LogReader
from recorders.writing.writer import RESERVED, LogWriter

source = LogReader(Path(sys.argv[1]))
files = {name: source.attachment(name) for name in source.attachments}
manifest = {name: value for name, value in source.manifest.items() if name not in RESERVED}
with LogWriter(Path(sys.argv[2]), manifest=manifest, attachments=files) as writer:
    for record in source:
        message = decode(record.type, record.data)
        if isinstance(message, JointState):
            order = sorted(range(len(message.name)), key=lambda place: message.name[place])
            names = tuple(message.name[place] for place in order)
            message = JointState(message.stamp_ns, names, message.position[order])
        writer.write(record.topic, message, log_time_ns=record.log_time_ns, sequence=record.sequence)
