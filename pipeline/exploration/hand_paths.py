"""Paths of demonstrated hands: from a CSV file, from poses in a log, or pose by pose as they come in."""

import hashlib
import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exploration.pose_track import MAX_COORDINATE, HandPath, PoseTrack
from pipeline.motions.csv_file import read_table
from pipeline.motions.motion import hand_columns, orientation_columns
from pipeline.motions.shown_turns import are_orientations
from recorders.containers.opening import open_log
from recorders.errors import LogError, MotionError
from recorders.files.whole_files import file_sha256
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import hand_target
from recorders.reading.parts import Log, files_of
from recorders.text.wording import names_text
from replay.sources.scheduled import naming, renamed

logger = logging.getLogger(__name__)

_NO_RENAMES: Mapping[str, str] = {}


@dataclass(frozen=True, eq=False)
class DemonstratedPaths:
    """Paths of the hands that somebody demonstrated.

    Attributes
    ----------
    name : str
        Of the source.
    paths : mapping of str to HandPath
        By hand; at least one.
    source : mapping
        Where it came from, for the manifest.
    """

    name: str
    paths: Mapping[str, HandPath]
    source: Mapping[str, Any]


def read_csv_paths(
    path: Path, hands: Sequence[str], *, hand: str | None = None, posed: Collection[str] = ()
) -> DemonstratedPaths:
    """Read hands from a CSV file with the columns t and those of some of the hands, or with t,x,y,z.

    Orientations are in four more columns of a hand, or qx,qy,qz,qw.

    Parameters
    ----------
    path : Path
        The file; times in seconds.
    hands : sequence of str
        The robot's hands, whose columns are those of `pipeline.motions.motion.hand_columns`.
    hand : str, optional
        The only hand to take; the one that x,y,z belong to.
    posed : collection of str
        Hands whose orientation is read too, where the file has it.

    Raises
    ------
    MotionError
        As `pipeline.motions.csv_file.read_table` does, if the columns are others, or a quaternion is no orientation.
    """
    sides: list[str] = []
    turned: dict[str, Sequence[str]] = {}

    def choose(header: Sequence[str]) -> Sequence[str]:
        """Choose the columns of the hands."""
        columns = _columns_by_hand(header, hands, hand)
        sides.extend(columns)
        turned.update({side: four for side in columns if side in posed if (four := _turn_columns(header, side))})
        if others := [side for side in columns if side not in posed and _turn_columns(header, side)]:
            logger.warning(
                f"{path.name}: orientations of {' and '.join(others)} are not followed: position alone counts"
            )
        rows = *columns.values(), *turned.values()
        return ["t", *(column for row in rows for column in row)]

    table = read_table(path, choose=choose, max_coordinate=MAX_COORDINATE)
    times_s, points, turns = np.split(table, [1, 1 + 3 * len(sides)], axis=1)
    orientations = dict(zip(turned, np.split(turns, max(1, len(turned)), axis=1), strict=False))
    for side, quaternions in orientations.items():
        if not (sound := are_orientations(quaternions)).all():
            row = int(np.argmin(sound)) + 1
            raise MotionError(f"{path}: row {row}: expected an orientation of {side}, found no length")
    paths = {
        side: HandPath(times_s[:, 0], points[:, 3 * k : 3 * k + 3], orientations.get(side))
        for k, side in enumerate(sides)
    }
    return DemonstratedPaths(
        path.stem, paths, {"kind": "csv", "name": path.name, "sha256": file_sha256(path), "hands": sides}
    )


def pose_topics(topic: str | None, hands: Sequence[str], *, hand: str | None) -> dict[str, str]:
    """Return the hand that each pose topic shows: `topic` one hand, by default the last; else the targets' topics."""
    if topic is not None:
        return {topic: hand or hands[-1]}
    return {hand_target(name): name for name in hands if hand in (None, name)}


def read_log_paths(
    path: Log, topics: Mapping[str, str], *, renames: Mapping[str, str] = _NO_RENAMES
) -> DemonstratedPaths:
    """Read hands from the poses of a log, timed by their stamps.

    Parameters
    ----------
    path : Path or Parts
        A log of any writer, or a session in parts, with CDR messages.
    topics : mapping of str to str
        Hand by topic.
    renames : mapping of str to str
        Our topic names for those of the log.

    Raises
    ------
    LogError
        The log cannot be read, or has no message on any of the topics; the line names its pose topics.
    MessageError
        A message on one of the topics is no PoseStamped.
    MotionError
        A hand has fewer than two usable poses.
    """
    reader = open_log(path)
    path = reader.path
    tracks = {side: PoseTrack() for side in topics.values()}
    with naming(path):
        for record in renamed(reader, renames, topics):
            tracks[topics[record.topic]].take(record)
    if not any(track.seen for track in tracks.values()):
        poses = [name for name, kind in reader.topics.items() if kind == PoseStamped.TYPE]
        found = names_text(name for name in poses if name not in renames) or "none"
        raise LogError(f"{path}: no message on {' or '.join(topics)}; its topics of {PoseStamped.TYPE}: {found}")
    source = {"kind": "log", "name": path.name, "sha256": file_sha256(*files_of(path))}
    return from_tracks(path.stem, tracks, source={**source, "topics": dict(topics), "renamed": dict(renames)})


def from_tracks(name: str, tracks: Mapping[str, PoseTrack], *, source: Mapping[str, Any]) -> DemonstratedPaths:
    """Return what the tracks of hands show; a hand without any pose is not shown.

    Raises
    ------
    MotionError
        A hand has fewer than two poses of use.
    """
    used = {side: track for side, track in tracks.items() if len(track)}
    for side, track in used.items() or tracks.items():
        if len(track) < 2:
            reasons = names_text(f"{count} with {reason}" for reason, count in track.left_out.items())
            but = f"; left out: {reasons}" if reasons else ""
            raise MotionError(f"{name}: expected at least two poses of the {side} hand, found {len(track)}{but}")
    origin_ns = min(track.first_ns for track in used.values())
    left_out = {side: dict(track.left_out) for side, track in used.items() if track.left_out}
    paths = {side: track.path(from_ns=origin_ns) for side, track in used.items()}
    return DemonstratedPaths(name, paths, {**source, "hands": list(used), "left_out": left_out})


def poses_sha256(tracks: Mapping[str, PoseTrack]) -> str:
    """SHA-256 over stamps and positions of all hands, in the order of their names."""
    digest = hashlib.sha256()
    for name in sorted(tracks):
        tracks[name].digest_into(digest)
    return digest.hexdigest()


def _turn_columns(header: Sequence[str], hand: str) -> Sequence[str]:
    """Return the four columns of a hand's orientation; none if there is none of them."""
    for columns in (orientation_columns(hand), ("qx", "qy", "qz", "qw")):
        there = set(columns) & set(header)
        if there and (missing := [column for column in columns if column not in there]):
            raise MotionError(f"the header lacks {names_text(missing)}: expected all four columns of an orientation")
        if there:
            return columns
    return ()


def _columns_by_hand(header: Sequence[str], hands: Sequence[str], hand: str | None) -> dict[str, list[str]]:
    """Return the three columns of each hand that is to be read."""
    by_name = {name: hand_columns(name) for name in hands if hand in (None, name)}
    found = {side: columns for side, columns in by_name.items() if set(columns) & set(header)}
    if missing := [column for columns in found.values() for column in columns if column not in header]:
        raise MotionError(f"the header lacks {names_text(missing)}: expected all three columns of a hand, or none")
    if "t" in header and found:
        return found
    if {"t", "x", "y", "z"} <= set(header):
        if hand is None:
            raise MotionError(f"expected a hand for the columns x,y,z, as with --hand {hands[-1]}")
        return {hand: ["x", "y", "z"]}
    each = ", ".join(",".join(hand_columns(name)) for name in hands)
    several = ", both" if len(hands) == 2 else ", several of them" if len(hands) > 2 else ""
    raise MotionError(f"the header lacks columns: expected t and {each}{several}, or x,y,z with a hand")
