"""Logs as motions to go through, and what the recorder wrote as an episode: between two ticks, and with the robot."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.evaluation.errors import HandErrors, posture_errors
from pipeline.evaluation.trials import trial_pairing
from pipeline.motions.motion import Motion
from pipeline.robot.config import TOML_FILE, URDF_FILE, RobotConfig
from pipeline.robot.coordinates import to_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.range_check import range_check
from pipeline.samples.pairs import read_samples
from recorders.cdr.codec import stamp_ns
from recorders.containers.opening import open_log
from recorders.errors import LogError, MotionError
from recorders.messages.topics import ROBOT_DESCRIPTION, commanded_tick, hand_measured, is_measured, is_of_tick
from recorders.reading.parts import one_session
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import Tick, TickJoiner
from recorders.writing.writer import LogWriter
from replay.sources.scheduled import naming, renamed

MAX_TICKS = 100_000
"""Most ticks of a log that is gone through: more than half an hour at 50 Hz."""

_NO_RENAMES: Mapping[str, str] = {}


def motion_of_log(path: Path, robot: RobotConfig) -> Motion:
    """Return the targets of a log in its own time; of a log without any, the hands as they were measured.

    Of a session in which stamps begin anew, what comes before that.

    Raises
    ------
    LogError
        If the log cannot be read, or has neither.
    MessageError, MotionError
        If what it has is none of this robot, or makes no motion.
    """
    reader = open_log(one_session([path]))
    topics = trial_pairing(reader, robot.hand_names, _NO_RENAMES).topics(robot.hand_names)
    check, ticks = range_check(robot), list[Tick]()
    with naming(reader.path):
        joiner = TickJoiner(check, topics, check.poses)
        for record in renamed(reader, _NO_RENAMES, topics):
            if ticks and (stamp_ns(record.type, record.data) or 0) < ticks[-1].stamp_ns:
                break
            ticks.extend(joiner.feed(record))
            if len(ticks) > MAX_TICKS:
                raise MotionError(f"{path}: expected at most {MAX_TICKS} ticks, found more")
    if len(ticks) < 2:
        raise MotionError(f"{path}: expected at least two ticks of {', '.join(topics)}, found {len(ticks)}")
    times_s = np.array([tick.stamp_ns - ticks[0].stamp_ns for tick in ticks]) * 1e-9
    inputs = np.array([np.concatenate(tick.hands) for tick in ticks])
    return Motion(path.stem, times_s, to_rows(robot, inputs), closed=False)


def recorded_errors(path: Path, robot: RobotConfig) -> HandErrors:
    """Return how far the hands were off the targets of an episode, as `evaluate` has it of who led; raises LogError."""
    samples = read_samples(path, robot=robot)
    return posture_errors(Kinematics(robot), samples.joints, samples.targets)


def write_episode(
    recorded: Path, out: Path, robot: RobotConfig, *, first_ns: int, last_ns: int, notes: Mapping[str, Any]
) -> int:
    """Write what a recorder recorded from one tick to another as an episode, and return how many ticks it has.

    It begins and ends with complete ticks, with the hands as measured too, and carries the robot.

    Parameters
    ----------
    recorded, out : Path
        The recording, and the episode.
    robot : RobotConfig
        The robot.
    first_ns, last_ns : int
        Stamps of the first and of the last tick that may be in it [ns].
    notes : mapping
        For the manifest.

    Raises
    ------
    LogError
        If fewer than two ticks are complete, or one between the others is not: messages were lost.
    """
    reader = LogReader(recorded)
    topics = {*commanded_tick(robot.hand_names), *map(hand_measured, robot.hand_names)} & set(reader.topics)
    stamps = (stamp_ns(record.type, record.data) or 0 for record in reader if record.topic in topics)
    parts = Counter(stamp for stamp in stamps if first_ns <= stamp <= last_ns)
    whole = sorted(stamp for stamp, count in parts.items() if count == len(topics))
    if len(whole) < 2:
        raise LogError(f"{out}: expected at least two complete ticks in the recording, found {len(whole)}")
    if lost := [stamp for stamp in parts if whole[0] < stamp < whole[-1] and parts[stamp] != len(topics)]:
        raise LogError(f"{out}: messages of {len(lost)} ticks were lost on their way to the recorder; record again")
    attachments = {URDF_FILE: robot.urdf_text.encode(), TOML_FILE: robot.toml_text.encode()}
    with LogWriter(out, manifest={"kind": "demonstration", **notes}, attachments=attachments) as writer:
        begun = False
        for record in reader:
            of_tick = is_of_tick(record.topic) or is_measured(record.topic)
            within = of_tick and whole[0] <= (stamp_ns(record.type, record.data) or 0) <= whole[-1]
            begun = begun or within
            if within or record.topic == ROBOT_DESCRIPTION or (begun and not of_tick):
                writer.copy(record)
    return len(whole)
