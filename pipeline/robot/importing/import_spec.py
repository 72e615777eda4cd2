"""Specification `import.toml` of an imported robot: the model, and its parts that are taken, added and left out."""

import importlib.metadata
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from pipeline.robot.toml_values import (
    Vector,
    as_list,
    as_name,
    as_number,
    as_point,
    as_table,
    check_keys,
    parse_toml,
    row_text,
)
from pipeline.urdf.description import MAX_BYTES
from recorders.errors import RobotError, file_reason
from recorders.files.regular_file import require_regular_file
from recorders.text.wording import names_text, value_text

_KEYS = frozenset({"source"})
_OPTIONAL_KEYS = frozenset({"base", "drop", "frozen", "limits", "virtual", "frames"})
_POSE_KEYS = frozenset({"xyz", "rpy"})
_FRAME_KEYS = frozenset({"name", "parent"})
_RANGE_KEYS, _MOTOR_KEYS = frozenset({"lower", "upper"}), frozenset({"effort", "velocity"})
_VIRTUAL_KEYS = frozenset({"name", "type", "axis", "lower", "upper", "effort", "velocity"})
_VIRTUAL_TYPES = ("revolute", "prismatic")
_ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Pose:
    """Pose of a frame in another: origin [m], and roll, pitch and yaw [rad] about that frame's fixed axes."""

    xyz: Vector = _ZERO
    rpy: Vector = _ZERO


@dataclass(frozen=True)
class VirtualJoint:
    """A joint that the model does not have, between the ground and the model's root. Units: m or rad, N or Nm, 1/s."""

    name: str
    type: str
    axis: Vector
    lower: float
    upper: float
    effort: float
    velocity: float


@dataclass(frozen=True)
class JointLimits:
    """Limits of a joint of the model in place of its own [rad or m, N m or N, 1/s]; None leaves what the model has."""

    lower: float
    upper: float
    effort: float | None = None
    velocity: float | None = None

    def given(self) -> dict[str, float]:
        """Return what is given, by the names that a URDF has for it."""
        found = {"lower": self.lower, "upper": self.upper, "effort": self.effort, "velocity": self.velocity}
        return {key: value for key, value in found.items() if value is not None}


@dataclass(frozen=True)
class AddedFrame:
    """A frame fixed to a link of the model, for a hand or the gaze."""

    name: str
    parent: str
    pose: Pose


@dataclass(frozen=True)
class RobotSource:
    """A robot's `import.toml`.

    Attributes
    ----------
    package : str or None
        Installed Python package that brings the model; None if the model lies beside `import.toml`.
    urdf : str
        Path of the model among the package's files, or its name beside `import.toml`.
    base : Pose
        Where the model's root stands in the world.
    drop : tuple of str
        Joints that are left out, with all that hangs on them.
    frozen : tuple of (str, float)
        Posture of joints that do not move in our robot [rad or m]; 0 for those not named.
    limits : tuple of (str, JointLimits)
        Limits of joints that have none, such as continuous ones, or wider ones.
    virtual : tuple of VirtualJoint
        Joints added between ground and root, from the ground up.
    frames : tuple of AddedFrame
        Frames added.
    """

    package: str | None
    urdf: str
    base: Pose = Pose()
    drop: tuple[str, ...] = ()
    frozen: tuple[tuple[str, float], ...] = ()
    limits: tuple[tuple[str, JointLimits], ...] = ()
    virtual: tuple[VirtualJoint, ...] = ()
    frames: tuple[AddedFrame, ...] = ()


def parse_source(toml_text: str) -> RobotSource:
    """Parse the text of an `import.toml`.

    Raises
    ------
    RobotError
        It does not parse, or a key is missing, unknown or of the wrong kind.
    """
    table = parse_toml(toml_text)
    check_keys(table, _KEYS, "import.toml", or_not=_OPTIONAL_KEYS)
    package, urdf = _model(table["source"])
    frozen, limits = _by_joint(table, "frozen"), _by_joint(table, "limits")
    return RobotSource(
        package=package,
        urdf=urdf,
        base=_pose(as_table(table.get("base", {}), frozenset(), "[base]", or_not=_POSE_KEYS), "[base]"),
        drop=tuple(as_name(name, "drop") for name in as_list(table.get("drop", []), "drop")),
        frozen=tuple(
            (as_name(name, "[frozen]"), as_number(value, f"[frozen] {name}")) for name, value in frozen.items()
        ),
        limits=tuple((as_name(name, "[limits]"), _limits(value, f"[limits] {name}")) for name, value in limits.items()),
        virtual=tuple(_virtual(row, index) for index, row in enumerate(as_list(table.get("virtual", []), "virtual"))),
        frames=tuple(_frame(row, index) for index, row in enumerate(as_list(table.get("frames", []), "frames"))),
    )


def read_text(path: Path) -> str:
    """Read one of a robot's files.

    Raises
    ------
    RobotError
        It cannot be read, is no regular file, or is not UTF-8.
    """
    require_regular_file(path, expected="a robot's file", error=RobotError)
    try:
        with path.open(encoding="utf-8") as file:
            return file.read(MAX_BYTES + 1)  # one character more than is allowed: checked with the text
    except OSError as error:
        raise RobotError(f"cannot read robot file '{path}': {file_reason(error)}") from error
    except UnicodeDecodeError as error:
        raise RobotError(f"cannot read robot file '{path}': expected UTF-8 text") from error


def read_source(source: RobotSource, directory: Path) -> str:
    """Read the model's URDF, out of its package or the robot's own directory.

    Raises
    ------
    RobotError
        The package is not installed, has no such file, or the file cannot be read.
    """
    if source.package is None:
        return read_text(directory / source.urdf)
    for file in _package_files(source.package):
        if file.as_posix() == source.urdf:
            return read_text(Path(str(file.locate())))
    raise RobotError(f"the package '{source.package}' has no file '{source.urdf}': expected the robot's model there")


def package_file(package: str, end: str) -> str:
    """Return the one file of an installed package whose path ends so, such as `urdf/panda.urdf`.

    Raises
    ------
    RobotError
        The package is not installed, or has no such file or several.
    """
    every = [file.as_posix() for file in _package_files(package)]
    found = [path for path in every if f"/{path}".endswith(f"/{end}")]
    if len(found) == 1:
        return found[0]
    urdfs = [path for path in every if path.endswith(".urdf")]
    raise RobotError(
        f"the package '{package}': expected one file whose path ends with '{end}', found "
        f"{names_text(found) or 'none'}" + ("" if found else f"; it has {names_text(urdfs) or 'no URDF'}")
    )


def _package_files(package: str) -> list[importlib.metadata.PackagePath]:
    try:
        return importlib.metadata.files(package) or []
    except importlib.metadata.PackageNotFoundError:
        raise RobotError(
            f"the robot's model comes with the package '{package}', which is not installed: "
            f"{sys.executable} -m pip install {package}"
        ) from None


def _model(value: object) -> tuple[str | None, str]:
    table = as_table(value, frozenset({"urdf"}), "[source]", or_not=frozenset({"package"}))
    urdf = as_name(table["urdf"], "[source] urdf")
    if "package" in table:
        return as_name(table["package"], "[source] package"), urdf
    if PurePosixPath(urdf).name != urdf:
        raise RobotError(
            f"[source] urdf of the robot config: expected a file beside import.toml, found {value_text(urdf)}"
        )
    return None, urdf


def _pose(table: Mapping[str, Any], where: str) -> Pose:
    return Pose(
        as_point(table.get("xyz", [0, 0, 0]), f"{where} xyz"), as_point(table.get("rpy", [0, 0, 0]), f"{where} rpy")
    )


def _by_joint(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return a table whose keys are joints; an empty one where there is none."""
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise RobotError(f"[{key}] of the robot config: expected a table, found {value_text(value)}")
    return value


def _limits(value: object, where: str) -> JointLimits:
    table = as_table(value, _RANGE_KEYS, where, or_not=_MOTOR_KEYS)
    return JointLimits(**{key: as_number(number, f"{key} of {where}") for key, number in table.items()})


def _virtual(value: object, index: int) -> VirtualJoint:
    table = as_table(value, _VIRTUAL_KEYS, row_text(value, "virtual joint", index))
    name = as_name(table["name"], f"name of virtual joint number {index + 1}")
    if table["type"] not in _VIRTUAL_TYPES:
        found = f"expected {' or '.join(_VIRTUAL_TYPES)}, found {value_text(table['type'])}"
        raise RobotError(f"type of {name} of the robot config: {found}")
    numbers = {key: as_number(table[key], f"{key} of {name}") for key in ("lower", "upper", "effort", "velocity")}
    return VirtualJoint(name, table["type"], as_point(table["axis"], f"axis of {name}"), **numbers)


def _frame(value: object, index: int) -> AddedFrame:
    table = as_table(value, _FRAME_KEYS, row_text(value, "frame", index), or_not=_POSE_KEYS)
    name = as_name(table["name"], f"name of frame number {index + 1}")
    return AddedFrame(name, as_name(table["parent"], f"parent of {name}"), _pose(table, name))
