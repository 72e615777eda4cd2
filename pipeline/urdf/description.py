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
from numpy.typing import ArrayLike

from pipeline.urdf.cleaning import cleaned
from recorders.errors import RobotError
from recorders.text.wording import names_text, value_text

WORLD = "world"  # what a link is called that is the ground; any other root is welded to it
MAX_BYTES = 4 * 2**20  # real ones take at most one megabyte
MAX_ELEMENTS = 100_000
MAX_DEPTH = 64  # elements within one another; libraries walk down by recursion
MAX_JOINTS = 1000  # fixed ones included; real ones have at most 200, and work grows with the square
MAX_SHAPES = 2000  # that are drawn; real ones have at most 200
MAX_PLACE = 1e3  # of an origin [m or rad]: of no robot, and its masses' lever arms are squared
MAX_CHAIN = 200  # joints one after another; libraries walk along them by recursion

_BETWEEN = {"xyz": (-MAX_PLACE, MAX_PLACE), "rpy": (-MAX_PLACE, MAX_PLACE), "rgba": (0.0, 1.0)}
_SHORTEST = 1e-3  # axis; libraries bring them to length 1
_MAX_NAME = 200  # characters
_MAX_NUMBERS = 200  # characters of an attribute
_JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_NUMBER = re.compile(r"[+-]?(\d++\.?\d*+|\.\d++)([eE][+-]?\d++)?", re.ASCII)  # in linear time

# How many numbers an attribute holds, by element: those that may be left out, and those that may not.
_OPTIONAL = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
_REQUIRED = {
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "color": {"rgba": 4},
    "limit": {"effort": 1, "velocity": 1},
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
        raise RobotError(f"{where}: expected a name, found {value_text(value)}")
    return value


def parse_urdf(urdf_text: str) -> ElementTree.Element:
    """Parse a URDF, check its names, references and numbers, and leave out what the program does not need.

    Raises
    ------
    RobotError
        The text is not a URDF, is too large or nested too deeply, has too many joints, joints in a row or shapes, a
        name or number in it is missing or malformed, or its links do not make one tree.
    """
    check_text(urdf_text, "robot description", most=MAX_BYTES)
    if not urdf_text.strip():
        raise RobotError("robot description: expected the text of a URDF, found none")
    try:
        root = ElementTree.fromstring(urdf_text, ElementTree.XMLParser(target=_Builder()))  # noqa: S314 - expat itself bounds the expansion of entities
    except ElementTree.ParseError as error:
        raise RobotError(f"robot description is not XML: {error}") from error
    if root.tag != "robot":
        raise RobotError(
            f"robot description is not URDF: expected the root element 'robot', found {value_text(root.tag)}"
        )
    check_name(root.get("name"), "name of the URDF")
    links, joints = named(root, "link"), named(root, "joint")
    if len(joints) > MAX_JOINTS:
        raise RobotError(f"robot description: expected at most {MAX_JOINTS} joints, found {len(joints)}")
    for joint in joints.values():
        _check_joint(joint, links)
    _check_tree(links, joints)
    robot = cleaned(root)
    if (shapes := len(robot.findall("link/visual")) + len(robot.findall("link/collision"))) > MAX_SHAPES:
        raise RobotError(f"robot description: expected at most {MAX_SHAPES} shapes of its links, found {shapes}")
    for part in robot:
        _check_numbers(part)
    for joint in robot.iterfind("joint"):
        _check_axis(joint)
    return robot


def canonical(urdf_text: str) -> ElementTree.Element:
    """Parse a URDF, and put its elements in an order of their own: by kind, then by name.

    Libraries lay out their arrays, and so the order of their sums, by the order in the file. Read in canonical order,
    two URDFs that differ only in that order give the same bits.

    Raises
    ------
    RobotError
        As `parse_urdf` does.
    """
    urdf = parse_urdf(urdf_text)
    urdf[:] = sorted(urdf, key=lambda element: (element.tag, element.get("name", "")))
    return urdf


def canonical_urdf(urdf_text: str) -> str:
    """Return the text of `canonical`: without what names a file, and so fit for any library."""
    return ElementTree.tostring(canonical(urdf_text), encoding="unicode")


def root_link(urdf: ElementTree.Element) -> str:
    """Return the one link of a parsed URDF that is no joint's child."""
    children = {_attribute(joint, "child", "link") for joint in urdf.iterfind("joint")}
    (root,) = (link.get("name", "") for link in urdf.iterfind("link") if link.get("name") not in children)
    return root


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


def end_link(joint: ElementTree.Element, end: str) -> str:
    """Return the link at an end of a joint, `parent` or `child`; an empty string if the joint names none."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def check_links(urdf: ElementTree.Element, frames: Sequence[str]) -> None:
    """Raise RobotError if a frame of the robot config is not a link of the URDF."""
    links = named(urdf, "link")
    if missing := [frame for frame in frames if frame not in links]:
        found = names_text(sorted(links))
        raise RobotError(f"frames {names_text(missing)} of the robot config are not links: {found}")


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
        """Open an element."""
        self._elements += 1
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise RobotError(f"robot description: expected elements at most {MAX_DEPTH} deep within one another")
        if self._elements > MAX_ELEMENTS:
            raise RobotError(f"robot description: expected at most {MAX_ELEMENTS} elements")
        if "xacro}" in tag:
            raise RobotError("robot description: expected a URDF, found one of macros; expand it with xacro first")
        return super().start(tag, attributes)

    def end(self, tag: str, /) -> ElementTree.Element:
        """Close an element."""
        self._depth -= 1
        return super().end(tag)


def _check_joint(joint: ElementTree.Element, links: Mapping[str, ElementTree.Element]) -> None:
    where = f"joint {joint.get('name')} of the URDF"
    if joint.get("type") not in _JOINT_TYPES:
        raise RobotError(
            f"{where}: expected a type of {names_text(_JOINT_TYPES)}, found {value_text(joint.get('type'))}"
        )
    for end in ("parent", "child"):
        link = _attribute(joint, end, "link")
        if link not in links:
            raise RobotError(f"{where}: expected the {end} to be a link of the URDF, found {value_text(link)}")


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
        raise RobotError(f"robot description: expected one link that is no child, found {names_text(roots) or 'none'}")
    reached, level, depth = set(roots), roots, 0
    while level := [child for link in level for child in children[link]]:  # each has one parent, so it ends
        reached.update(level)
        depth += 1
    if depth > MAX_CHAIN:
        raise RobotError(f"robot description: expected at most {MAX_CHAIN} joints in a row, found {depth}")
    if loose := sorted(children.keys() - reached):
        raise RobotError(f"links {names_text(loose)} of the URDF hang on one another in a ring")


def _check_numbers(part: ElementTree.Element) -> None:
    where = f"{part.tag} {value_text(part.get('name', ''))} of the URDF"
    for element in part.iter():
        optional, required = (table.get(element.tag, {}) for table in (_OPTIONAL, _REQUIRED))
        if missing := sorted(required.keys() - element.keys()):
            raise RobotError(f"{where}: expected <{element.tag} {missing[0]}=...>, found none")
        for attribute, count in (optional | required).items():
            text = element.get(attribute)
            if text is not None and not _holds_numbers(text, count):
                found = f"{count} finite number{'s' * (count > 1)}, found {value_text(text)}"
                raise RobotError(f"{where}: expected <{element.tag} {attribute}=...> to hold {found}")
            low, high = _BETWEEN.get(attribute, (-math.inf, math.inf))
            if text is not None and not all(low <= float(number) <= high for number in text.split()):
                expected = f"numbers from {low:g} to {high:g}, found {value_text(text)}"
                raise RobotError(f"{where}: expected <{element.tag} {attribute}=...> to hold {expected}")


def _check_axis(joint: ElementTree.Element) -> None:
    axis = joint.find("axis")
    if joint.get("type") == "fixed" or axis is None:
        return
    length = math.hypot(*map(float, axis.get("xyz", "").split()))
    if not _SHORTEST <= length <= 1.0 / _SHORTEST:
        raise RobotError(f"joint {joint.get('name')} of the URDF: expected an axis of length 1, found {length:g}")


def _holds_numbers(text: str, count: int) -> bool:
    """Return whether urdfdom reads so many numbers: it splits at spaces and allows none around a single number."""
    numbers = [text] if count == 1 else [part for part in text.split(" ") if part]
    if len(text) > _MAX_NUMBERS or len(numbers) != count:
        return False
    return all(_NUMBER.fullmatch(number) and math.isfinite(float(number)) for number in numbers)


def _attribute(joint: ElementTree.Element, child: str, attribute: str) -> str:
    element = joint.find(child)
    value = None if element is None else element.get(attribute)
    if value is None:
        raise RobotError(f"joint {joint.get('name')} of the URDF: expected <{child} {attribute}=...>, found none")
    return value
