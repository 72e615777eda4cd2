"""Import of a model as URDF: fewer joints, no meshes, a pose in the world, a motor for every joint.

The text that comes out stands for itself: logs and controllers carry it, and nothing later needs the model.
Pinocchio does the geometry: it fixes the joints that are not wanted and joins the masses of what is then one body.
"""

from collections.abc import Iterable, Mapping, Sequence
from xml.etree.ElementTree import Element, SubElement, tostring

from pipeline.robot.importing.import_spec import Pose, RobotSource
from pipeline.robot.importing.reduction import reduced_model
from pipeline.robot.importing.urdf_writer import write_urdf
from pipeline.urdf.bodies import body_faults, faults_text
from pipeline.urdf.description import WORLD, as_numbers, check_links, end_link, named, parse_urdf, root_link
from recorders.errors import RobotError
from recorders.text.wording import names_text

_STAND = "model_stand"
"""Joint that sets the model's root on the ground, or on the joints that are added."""


def import_urdf(
    model_text: str,
    source: RobotSource,
    *,
    name: str,
    joints: Sequence[str],
    frames: Sequence[str],
    hands: Mapping[str, str],
) -> str:
    """Make the URDF of a robot from a model of others.

    The links that the robot's joints move keep their names, frames and joint axes; what hangs on them rigidly is joined
    to them. Equal input gives equal text.

    Parameters
    ----------
    model_text : str
        The model's URDF.
    source : RobotSource
        What is taken from it, added and left out.
    name : str
        The robot's name.
    joints : sequence of str
        The joints that stay, those of `source.virtual` included; all others are fixed.
    frames : sequence of str
        Links that must not be joined to others: those of the hands, and the frame of the gaze.
    hands : mapping of str to str
        Names of the hands, by link.

    Raises
    ------
    RobotError
        The model is not a URDF or does not build, or a name is not one of it; the message names what exists.
    """
    whole = _assembled(parse_urdf(model_text), source, name)
    _check_movable(whole, joints, "joints")
    frozen = [joint for joint, _ in source.frozen]
    _check_movable(whole, frozen, "[frozen] joints")
    if both := [joint for joint in frozen if joint in joints]:
        raise RobotError(f"[frozen] joints {_list(both)} are among the robot's joints: expected them in one place")
    check_links(whole, frames)
    model = reduced_model(whole, joints=joints, frozen=dict(source.frozen))
    return write_urdf(whole, model, joints=joints, frames=frames, hands=hands)


def _assembled(model: Element, source: RobotSource, name: str) -> Element:
    """Return links with their masses, and joints: those of the model that are not dropped, and those that are added."""
    robot = Element("robot", name=name)
    SubElement(robot, "link", name=WORLD)
    _rename_root(model)
    root = root_link(model)
    dropped = _below(model, source.drop)
    for link in model.iterfind("link"):
        if link.get("name") not in dropped:
            SubElement(robot, "link", name=link.get("name", "")).extend(link.findall("inertial"))
    robot.extend(joint for joint in model.iterfind("joint") if end_link(joint, "child") not in dropped)
    _stand(robot, root, source)
    for frame in source.frames:
        check_links(robot, [frame.parent])
        _add_joint(robot, f"{frame.name}_frame", "fixed", frame.parent, frame.name, frame.pose)
        SubElement(robot, "link", name=frame.name)
    _set_limits(robot, source)
    _check_limits(robot)
    whole = parse_urdf(tostring(robot, encoding="unicode"))  # once more: names that were added may exist already
    _check_bodies(whole)
    return whole


def _check_bodies(whole: Element) -> None:
    """Raise RobotError for links that are no bodies, with the joints that leave them out."""
    if faults := body_faults(whole):
        above = {end_link(joint, "child"): joint.get("name", "") for joint in whole.iterfind("joint")}
        drop = " ".join(f"--drop {above[link]}" for link in faults if above[link] != _STAND)
        advice = "mend a copy of the model"
        if drop:
            advice += f", or leave out what you do not need, with all that hangs on it: {drop} (drop in import.toml)"
        raise RobotError(f"{faults_text(faults)}; {advice}")


def _set_limits(robot: Element, source: RobotSource) -> None:
    """Give joints the limits of `source`; one that turns without end then turns between them."""
    joints = {joint.get("name", ""): joint for joint in robot.iterfind("joint")}
    _check_movable(robot, [name for name, _ in source.limits], "[limits] joints")
    for name, limits in source.limits:
        joint, given = joints[name], limits.given()
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = SubElement(joint, "limit")
        limit.attrib.update({key: as_numbers(value) for key, value in given.items()})
        if missing := [key for key in ("effort", "velocity") if key not in limit.attrib]:
            raise RobotError(f"[limits] {name}: expected {missing[0]}, which the model does not have, found none")


def _check_limits(robot: Element) -> None:
    for joint in robot.iterfind("joint"):
        if joint.get("type") in ("revolute", "prismatic") and joint.find("limit") is None:
            raise RobotError(
                f"joint {joint.get('name')} of the model: expected <limit lower=... upper=...>, found none"
            )


def _rename_root(model: Element) -> None:
    """Give a root called `world` another name: it is to stand in ours."""
    if (root := root_link(model)) == WORLD:
        for element in (*model.iterfind("link"), *model.iterfind("joint/parent")):
            attribute = "name" if element.tag == "link" else "link"
            if element.get(attribute) == root:
                element.set(attribute, "model_world")


def _stand(robot: Element, root: str, source: RobotSource) -> None:
    """Set the model's root on the virtual joints, which move along and about the axes of the world."""
    parent, xyz = WORLD, source.base.xyz
    for joint in source.virtual:
        child = f"{joint.name}_link"
        element = _add_joint(robot, joint.name, joint.type, parent, child, Pose(xyz))
        SubElement(element, "axis", xyz=as_numbers(joint.axis))
        limits = {key: as_numbers([getattr(joint, key)]) for key in ("lower", "upper", "effort", "velocity")}
        SubElement(element, "limit", limits)
        SubElement(robot, "link", name=child)
        parent, xyz = child, Pose().xyz
    _add_joint(robot, _STAND, "fixed", parent, root, Pose(xyz, source.base.rpy))


def _add_joint(robot: Element, name: str, kind: str, parent: str, child: str, pose: Pose) -> Element:
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "origin", xyz=as_numbers(pose.xyz), rpy=as_numbers(pose.rpy))
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    return joint


def _below(model: Element, joints: Iterable[str]) -> set[str]:
    """Links that hang on some joints, at any depth."""
    existing = named(model, "joint")
    if missing := [joint for joint in joints if joint not in existing]:
        raise RobotError(f"drop: joints {_list(missing)} are not in the model, which has {_list(sorted(existing))}")
    children: dict[str, list[str]] = {}
    for joint in existing.values():
        children.setdefault(end_link(joint, "parent"), []).append(end_link(joint, "child"))
    below = [end_link(existing[name], "child") for name in joints]
    for link in below:
        below.extend(children.get(link, []))  # while it is walked along: links make a tree, so it ends
    return set(below)


def _check_movable(robot: Element, joints: Iterable[str], what: str) -> None:
    movable = sorted(name for name, joint in named(robot, "joint").items() if joint.get("type") != "fixed")
    if missing := [joint for joint in joints if joint not in movable]:
        raise RobotError(
            f"{what} {_list(missing)} of the robot config are not movable joints of the model, "
            f"which has {_list(movable) or 'none'}"
        )


def _list(names: Iterable[str]) -> str:
    return names_text(names)
