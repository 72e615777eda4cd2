"""Robots as data: a URDF and a TOML file become one checked, immutable `RobotConfig`."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.resources import data_path
from pipeline.robot.hands import Hand, parse_hands
from pipeline.robot.importing.import_spec import parse_source, read_source, read_text
from pipeline.robot.resolution import UNLIMITED, Resolution, parse_resolution
from pipeline.robot.toml_values import as_name, as_number, as_table, as_vector, check_keys, parse_toml, row_text
from pipeline.robot.upgrade import upgraded
from pipeline.urdf.bodies import check_bodies
from pipeline.urdf.description import WORLD, canonical_urdf, check_links, named, parse_urdf, root_link
from pipeline.urdf.joints import joint_limits, moved_links, speed_limits
from recorders.errors import RobotError
from recorders.text.wording import names_text, value_text

URDF_FILE = "robot.urdf"
TOML_FILE = "robot.toml"
IMPORT_FILE = "import.toml"

_KEYS = frozenset({"name", "joints", "hands"})
_OPTIONAL_KEYS = frozenset({"gaze", "pattern", "resolution"})
_JOINT_KEYS = frozenset({"name", "weight", "comfort"})
_GAZE_KEYS = frozenset({"joint", "frame"})
_PLANE = {"lateral": (0.0, 1.0, 0.0), "up": (0.0, 0.0, 1.0)}  # of the patterns, where a config names none: for x ahead


@dataclass(frozen=True)
class Gaze:
    """The joint that turns towards the targets, and a link that it moves: x ahead, z along the joint's axis."""

    joint: str
    frame: str


@dataclass(frozen=True, eq=False)
class RobotConfig:
    """All that the program knows of a robot. Postures are arrays in the order of `joints`; n = len(joints).

    Attributes
    ----------
    name : str
    joints : tuple of str, length n
    lower, upper : ndarray
        Position limits [rad or m], shape (n,).
    weights : ndarray
        Cost of leaving the comfort posture, relative to each joint's range, shape (n,).
    comfort : ndarray
        Comfort posture [rad or m], shape (n,); also the constant on which learned outputs are centred.
    hands : tuple of Hand
        The hands, in the order of the learner's inputs; at least one.
    gaze : Gaze or None
        What turns towards the targets, if anything does.
    lateral, up : ndarray
        Unit vectors of the plane in which the hands draw, world frame, shape (3,).
    resolution : Resolution
        Of the simulated robot's sensors and motors.
    urdf_text, toml_text : str
        The two files as they were read, for a log's attachments.
    """

    name: str
    joints: tuple[str, ...]
    lower: Floats
    upper: Floats
    weights: Floats
    comfort: Floats
    hands: tuple[Hand, ...]
    gaze: Gaze | None
    lateral: Floats
    up: Floats
    resolution: Resolution
    urdf_text: str
    toml_text: str

    def __post_init__(self) -> None:
        for field in ("lower", "upper", "weights", "comfort", "lateral", "up"):
            array = np.array(getattr(self, field), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, field, array)

    @property
    def plain_urdf(self) -> str:
        """The URDF without meshes and all else that names a file or is of no use here: fit for any library."""
        return canonical_urdf(self.urdf_text)

    @property
    def hand_names(self) -> tuple[str, ...]:
        """Names of the hands, in their order."""
        return tuple(hand.name for hand in self.hands)

    @property
    def centres(self) -> Floats:
        """Centre of each hand's pattern and box [m], world frame, shape (hands, 3)."""
        return np.array([hand.centre for hand in self.hands])

    @property
    def boxes(self) -> Floats:
        """Half extents of each hand's box [m], shape (hands, 3)."""
        return np.array([hand.box for hand in self.hands])

    @cached_property
    def speed_limits(self) -> Floats:
        """Speed limits of the joints [rad/s or m/s], shape (n,); infinite where the URDF states 0 or none."""
        limits = speed_limits(parse_urdf(self.urdf_text), self.joints)
        limits.setflags(write=False)
        return limits

    @cached_property
    def input_centre(self) -> Floats:
        """Centres of all hands in a row, shape (inputs,): three numbers [m] each, and no turn [rad] if one counts."""
        centre = np.concatenate([[*hand.centre, *(() if hand.turn is None else (0.0,) * 3)] for hand in self.hands])
        centre.setflags(write=False)
        return centre

    @cached_property
    def input_reach(self) -> Floats:
        """Half extents of the boxes of all hands in a row, shape (inputs,): [m], and [rad] where the turn counts."""
        reach = np.concatenate([[*hand.box, *(hand.turn or ())] for hand in self.hands])
        reach.setflags(write=False)
        return reach

    @property
    def frames(self) -> tuple[str, ...]:
        """Links of the hands, and the frame of the gaze if there is one."""
        return _frames(self.hands, self.gaze)


def robot_names() -> list[str]:
    """Names of the robots that come with the program."""
    root = data_path("robots")
    return sorted(entry.name for entry in root.glob("*") if (entry / TOML_FILE).is_file())


def load_robot(name_or_directory: str | Path) -> RobotConfig:
    """Load a robot that comes with the program, or one from a directory.

    The directory holds `robot.toml` and either `robot.urdf`, or `import.toml`, which names from what model of others,
    and how, the URDF is made.

    Raises
    ------
    RobotError
        The robot is unknown, a file cannot be read, the package with its model is not installed, or the files do not
        make a usable robot.
    """
    names = robot_names()
    packaged = str(name_or_directory) in names
    directory = data_path("robots", str(name_or_directory)) if packaged else Path(name_or_directory)
    if not directory.is_dir():
        raise RobotError(f"unknown robot '{name_or_directory}': {_expected(directory, names)}")
    toml_text = read_text(directory / TOML_FILE)
    if (directory / IMPORT_FILE).exists():
        urdf_text = _imported(toml_text, directory)
    else:
        urdf_text = read_text(directory / URDF_FILE)
    return parse_robot(toml_text, urdf_text, origin=f"robot '{directory}'")


def _expected(path: Path, names: Sequence[str]) -> str:
    """Return what a robot's name or folder is, where it is neither; of a URDF, how it becomes a folder."""
    if path.suffix.lower() in (".urdf", ".xml") and path.is_file():
        return f"expected a robot's folder, found a file; `reenact robot new {path} --hand LINK --out DIR` makes one"
    return f"expected one of {names_text(names)}, or a directory"


def _imported(toml_text: str, directory: Path) -> str:
    """Return the URDF text that the directory's `import.toml` makes."""
    from pipeline.robot.importing.urdf_import import import_urdf  # noqa: PLC0415  # Pinocchio: a URDF does without

    import_text = read_text(directory / IMPORT_FILE)
    with _naming(f"robot '{directory}'"):
        parts, source = _parse_config(toml_text), parse_source(import_text)
    model_text = read_source(source, directory)
    with _naming(f"robot '{directory}'"):
        return import_urdf(
            model_text,
            source,
            name=parts["name"],
            joints=parts["joints"],
            frames=_frames(parts["hands"], parts["gaze"]),
            hands={hand.link: hand.name for hand in parts["hands"]},
        )


@contextmanager
def _naming(origin: str) -> Iterator[None]:
    """Add the robot's name to an error."""
    try:
        yield
    except RobotError as error:
        raise RobotError(f"{origin}: {error}") from error


def parse_robot(toml_text: str, urdf_text: str, *, origin: object = None) -> RobotConfig:
    """Make a robot from the texts of its two files, wherever they come from (a directory, a log's attachments).

    Parameters
    ----------
    toml_text, urdf_text : str
        The texts.
    origin : object
        Where they come from, for messages: a path, or words.

    Raises
    ------
    RobotError
        A text does not parse, a key is missing, unknown or of the wrong kind, or the two do not fit together.
    """
    if origin is not None:
        with _naming(str(origin)):
            return parse_robot(toml_text, urdf_text)
    parts = _parse_config(toml_text)
    urdf = parse_urdf(urdf_text)
    if (root := root_link(urdf)) != WORLD and WORLD in named(urdf, "link"):
        raise RobotError(f"link {WORLD} of the URDF: expected it to be the link that is no child, which is {root}")
    check_bodies(urdf, moved=moved_links(urdf))
    lower, upper = joint_limits(urdf, parts["joints"])
    check_links(urdf, _frames(parts["hands"], parts["gaze"]))
    _check_comfort(parts["joints"], lower, parts["comfort"], upper)
    return RobotConfig(**parts, lower=lower, upper=upper, urdf_text=urdf_text, toml_text=toml_text)


def _parse_config(toml_text: str) -> dict[str, Any]:
    """Return what `robot.toml` holds, of today's or an older form, as the arguments of a RobotConfig."""
    table = upgraded(parse_toml(toml_text))
    check_keys(table, _KEYS, "the robot config", or_not=_OPTIONAL_KEYS)
    joints, weights, comfort = _joints(table["joints"])
    return {
        "name": as_name(table["name"], "name"),
        "joints": joints,
        "weights": weights,
        "comfort": comfort,
        "hands": parse_hands(table["hands"]),
        "gaze": _gaze(table["gaze"], joints) if "gaze" in table else None,
        **_plane(table.get("pattern", {key: list(vector) for key, vector in _PLANE.items()})),
        "resolution": parse_resolution(table["resolution"]) if "resolution" in table else UNLIMITED,
    }


def _gaze(value: object, joints: Sequence[str]) -> Gaze:
    table = as_table(value, _GAZE_KEYS, "[gaze]")
    gaze = Gaze(as_name(table["joint"], "[gaze] joint"), as_name(table["frame"], "[gaze] frame"))
    if gaze.joint not in joints:
        raise RobotError(f"[gaze] joint '{gaze.joint}' is not among the robot's joints: {names_text(joints)}")
    return gaze


def _frames(hands: Sequence[Hand], gaze: Gaze | None) -> tuple[str, ...]:
    return (*(hand.link for hand in hands), *(() if gaze is None else (gaze.frame,)))


def _joints(value: object) -> tuple[tuple[str, ...], Floats, Floats]:
    if not isinstance(value, list) or not value:
        raise RobotError(f"joints of the robot config: expected a list of tables, found {value_text(value)}")
    rows = [as_table(row, _JOINT_KEYS, row_text(row, "joint", index)) for index, row in enumerate(value)]
    names = tuple(as_name(row["name"], f"name of joint number {index + 1}") for index, row in enumerate(rows))
    if repeated := sorted(name for name, count in Counter(names).items() if count > 1):
        raise RobotError(f"joints of the robot config: {names_text(repeated)} given more than once")
    weights = [as_number(row["weight"], f"weight of {row['name']}") for row in rows]
    comfort = [as_number(row["comfort"], f"comfort of {row['name']}") for row in rows]
    if min(weights) <= 0.0:
        name = names[weights.index(min(weights))]
        raise RobotError(f"weight of {name} of the robot config: expected above 0, found {min(weights)}")
    return names, np.array(weights), np.array(comfort)


def _plane(value: object) -> dict[str, Floats]:
    table = as_table(value, frozenset(_PLANE), "[pattern]")
    vectors = {key: as_vector(table[key], f"[pattern] {key}") for key in _PLANE}
    for key in _PLANE:
        length = math.hypot(*vectors[key])
        if not math.isclose(length, 1.0, abs_tol=1e-9):
            raise RobotError(f"[pattern] {key} of the robot config: expected length 1, found {length:g}")
    if abs(cosine := float(vectors["lateral"] @ vectors["up"])) > 1e-9:
        raise RobotError(
            f"[pattern] of the robot config: expected up at right angles to lateral, found cosine {cosine:g}"
        )
    return vectors


def _check_comfort(joints: Sequence[str], lower: Floats, comfort: Floats, upper: Floats) -> None:
    for name, low, value, high in zip(joints, lower, comfort, upper, strict=True):
        if not low < value < high:
            raise RobotError(f"comfort of {name}: expected between its limits {low:g} and {high:g}, found {value:g}")
