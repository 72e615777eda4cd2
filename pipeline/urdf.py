"""The robot description: URDF text becomes a checked XML tree before any library in C++ reads it.

Those libraries drop what they cannot read, each in its own way, and write about it to the terminal. What is
checked here is refused in one line instead.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recorders.errors import RobotError

Floats = NDArray[np.float64]

MAX_BYTES = 16 * 2**20  # real ones take at most one megabyte
MAX_ELEMENTS = 100_000
MAX_DEPTH = 64  # elements within one another; libraries walk down by recursion

_MAX_NAME = 200  # characters
_JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)

# How many numbers an attribute holds, by element: those that may be left out, and those that may not.
_OPTIONAL = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mesh": {"scale": 3},
    "limit": {"lower": 1, "upper": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "calibration": {"rising": 1, "falling": 1},
    "safety_controller": {"k_position": 1, "soft_lower_limit": 1, "soft_upper_limit": 1},
}
_REQUIRED = {
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "color": {"rgba": 4},
    "limit": {"effort": 1, "velocity": 1},
    "safety_controller": {"k_velocity": 1},
}


def check_text(text: str, what: str, *, most: int) -> None:
    """Check that a text has at most `most` bytes, and that UTF-8 can hold it.

    Raises
    ------
    RobotError
        It is not.
    """
    try:
        size = len(text.encode())
    except UnicodeEncodeError as error:
        raise RobotError(f"{what}: expected UTF-8 text, found {text[error.start]!r}") from None
    if size > most:
        raise RobotError(f"{what}: expected at most {most} bytes, found {size}")


def check_name(value: object, where: str) -> str:
    """Return `value` if it can stand as a name in one line of text; raises RobotError otherwise."""
    if not isinstance(value, str) or not value or not value.isprintable() or len(value) > _MAX_NAME:
        raise RobotError(f"{where}: expected a name, found {shown(value)}")
    return value


def shown(value: object) -> str:
    """Show a value of any size or kind within a message, in at most 80 characters."""
    try:
        return f"{value!r:.80}"
    except (ValueError, RecursionError):  # an integer of thousands of digits, a table of thousands of levels
        return f"a huge {type(value).__name__}"


def one_line(text: str) -> str:
    """Bring text of others into one line of at most 1000 characters, for a message."""
    return f"{' '.join(text.split()):.1000}"


def parse_urdf(urdf_text: str) -> ElementTree.Element:
    """Parse a URDF, and check its names, references and numbers.

    Raises
    ------
    RobotError
        The text is not a URDF, is too large or nested too deeply, a name or number in it is missing or malformed,
        a mass cannot be one, or its links do not make one tree.
    """
    check_text(urdf_text, "robot description", most=MAX_BYTES)
    if not urdf_text.strip():
        raise RobotError("robot description: expected the text of a URDF, found none")
    try:
        root = ElementTree.fromstring(urdf_text, ElementTree.XMLParser(target=_Builder()))  # noqa: S314 - expat itself bounds the expansion of entities
    except ElementTree.ParseError as error:
        raise RobotError(f"robot description is not XML: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"robot description is not URDF: expected the root element 'robot', found {shown(root.tag)}")
    check_name(root.get("name"), "name of the URDF")
    links, joints = named(root, "link"), named(root, "joint")
    for joint in joints.values():
        _check_joint(joint, links)
    _check_tree(links, joints)
    for part in (*links.values(), *joints.values(), *root.iterfind("material")):
        _check_numbers(part)
    _check_masses(links, joints)
    return root


def canonical_urdf(urdf_text: str) -> str:
    """Return the same URDF with its elements in an order of their own: by kind, then by name.

    Libraries lay out their arrays, and so the order of their sums, by the order in the file. Read in canonical order,
    two URDFs that differ only in that order give the same bits.

    Raises
    ------
    RobotError
        As `parse_urdf` does.
    """
    urdf = parse_urdf(urdf_text)
    urdf[:] = sorted(urdf, key=lambda element: (element.tag, element.get("name", "")))
    return ElementTree.tostring(urdf, encoding="unicode")


def joint_links(urdf_text: str) -> dict[str, tuple[str, str]]:
    """Parent and child link of every joint of a URDF, fixed ones included, in canonical order.

    Raises
    ------
    RobotError
        As `parse_urdf` does.
    """
    joints = named(parse_urdf(urdf_text), "joint")
    return {
        name: (_attribute(joints[name], "parent", "link"), _attribute(joints[name], "child", "link"))
        for name in sorted(joints)
    }


def joint_limits(urdf: ElementTree.Element, joints: Sequence[str]) -> tuple[Floats, Floats]:
    """Lower and upper position limits [rad or m] of all movable joints, in the order of `joints`, each (n,).

    Raises
    ------
    RobotError
        `joints` are not the movable joints of the URDF, or one has no limits or no transmission.
    """
    movable = {name: joint for name, joint in named(urdf, "joint").items() if joint.get("type") != "fixed"}
    motors = {element.get("name", "") for element in urdf.iterfind("transmission/joint")}
    if missing := [name for name in joints if name not in movable]:
        raise RobotError(
            f"joints {one_line(', '.join(missing))} of the robot config are not movable joints of the URDF, "
            f"which has {one_line(', '.join(sorted(movable)))}"
        )
    if unnamed := sorted(movable.keys() - set(joints)):
        raise RobotError(f"movable joints {one_line(', '.join(unnamed))} of the URDF are not in the robot config")
    if unmoved := [name for name in joints if name not in motors]:
        raise RobotError(
            f"joints {one_line(', '.join(unmoved))} of the URDF have no transmission, so nothing would move them"
        )
    lower, upper = ([float(_attribute(movable[name], "limit", side)) for name in joints] for side in ("lower", "upper"))
    return np.array(lower), np.array(upper)


def check_links(urdf: ElementTree.Element, frames: Sequence[str]) -> None:
    """Raise RobotError if a frame of the robot config is not a link of the URDF."""
    links = named(urdf, "link")
    if missing := [frame for frame in frames if frame not in links]:
        found = one_line(", ".join(sorted(links)))
        raise RobotError(f"frames {', '.join(missing)} of the robot config are not links: {found}")


def named(root: ElementTree.Element, kind: str) -> dict[str, ElementTree.Element]:
    """All elements of a kind, link or joint, by name.

    Raises
    ------
    RobotError
        A name is missing, cannot stand in a line of text, or is given more than once.
    """
    found: dict[str, ElementTree.Element] = {}
    for element in root.iterfind(kind):
        name = check_name(element.get("name"), f"name of a {kind} of the URDF")
        if name in found:
            raise RobotError(f"{kind} {name} of the URDF is given more than once")
        found[name] = element
    return found


def as_numbers(values: ArrayLike) -> str:
    """Write numbers as an attribute's text, to 12 digits: the last bits depend on the machine that computed them."""
    rounded = (round(float(value), 12) + 0.0 for value in np.ravel(values))  # + 0.0 makes -0.0 a plain 0
    return " ".join(f"{value:.12g}" for value in rounded)


class _Builder(ElementTree.TreeBuilder):
    """Builds the tree of a document that is neither deep nor endless."""

    def __init__(self) -> None:
        super().__init__()
        self._elements = self._depth = 0

    def start(self, tag: str, attributes: dict[str, str], /) -> ElementTree.Element:
        self._elements += 1
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise RobotError(f"robot description: expected elements at most {MAX_DEPTH} deep within one another")
        if self._elements > MAX_ELEMENTS:
            raise RobotError(f"robot description: expected at most {MAX_ELEMENTS} elements")
        return super().start(tag, attributes)

    def end(self, tag: str, /) -> ElementTree.Element:
        self._depth -= 1
        return super().end(tag)


def _check_joint(joint: ElementTree.Element, links: Mapping[str, ElementTree.Element]) -> None:
    where = f"joint {joint.get('name')} of the URDF"
    if joint.get("type") not in _JOINT_TYPES:
        raise RobotError(f"{where}: expected a type of {', '.join(_JOINT_TYPES)}, found {shown(joint.get('type'))}")
    for end in ("parent", "child"):
        link = _attribute(joint, end, "link")
        if link not in links:
            raise RobotError(f"{where}: expected the {end} to be a link of the URDF, found {shown(link)}")


def _check_tree(links: Iterable[str], joints: Mapping[str, ElementTree.Element]) -> None:
    children: dict[str, list[str]] = {link: [] for link in links}
    for joint in joints.values():
        children[_attribute(joint, "parent", "link")].append(_attribute(joint, "child", "link"))
    held = Counter(link for held_links in children.values() for link in held_links)
    if several := sorted(link for link, count in held.items() if count > 1):
        raise RobotError(
            f"link {several[0]} of the URDF: expected it to be the child of one joint, found {held[several[0]]}"
        )
    if len(roots := sorted(children.keys() - held.keys())) != 1:
        raise RobotError(
            f"robot description: expected one link that is no child, found {one_line(', '.join(roots)) or 'none'}"
        )
    reached = roots
    for link in reached:
        reached.extend(children[link])  # while it is walked along: each link has one parent, so it ends
    if loose := sorted(children.keys() - set(reached)):
        raise RobotError(f"links {one_line(', '.join(loose))} of the URDF hang on one another in a ring")


def _check_numbers(part: ElementTree.Element) -> None:
    where = f"{part.tag} {shown(part.get('name', ''))} of the URDF"
    for element in part.iter():
        optional, required = (table.get(element.tag, {}) for table in (_OPTIONAL, _REQUIRED))
        if missing := sorted(required.keys() - element.keys()):
            raise RobotError(f"{where}: expected <{element.tag} {missing[0]}=...>, found none")
        for attribute, count in (optional | required).items():
            text = element.get(attribute)
            if text is not None and not _holds_numbers(text, count):
                found = f"{count} finite number{'s' * (count > 1)}, found {shown(text)}"
                raise RobotError(f"{where}: expected <{element.tag} {attribute}=...> to hold {found}")


def _check_masses(links: Mapping[str, ElementTree.Element], joints: Mapping[str, ElementTree.Element]) -> None:
    """Check the masses of links; a link that has none is a frame, and may stand anywhere."""
    moved = {_attribute(joint, "child", "link") for joint in joints.values() if joint.get("type") != "fixed"}
    for name, link in links.items():
        for mass in link.iterfind("inertial/mass"):
            value = float(mass.get("value", ""))
            if value == 0.0 and name in moved:
                raise RobotError(
                    f"link {name} of the URDF: expected a mass above 0, as a joint moves it, found 0; "
                    "a mere frame has no <inertial>"
                )
            if value < 0.0:
                raise RobotError(f"link {name} of the URDF: expected a mass above 0, found {value:g}")


def _holds_numbers(text: str, count: int) -> bool:
    """Whether urdfdom reads so many numbers, which goes by spaces and allows none around a single number."""
    numbers = [text] if count == 1 else [part for part in text.split(" ") if part]
    return len(numbers) == count and all(_NUMBER.fullmatch(n) and math.isfinite(float(n)) for n in numbers)


def _attribute(joint: ElementTree.Element, child: str, attribute: str) -> str:
    element = joint.find(child)
    value = None if element is None else element.get(attribute)
    if value is None:
        raise RobotError(f"joint {joint.get('name')} of the URDF: expected <{child} {attribute}=...>, found none")
    return value
