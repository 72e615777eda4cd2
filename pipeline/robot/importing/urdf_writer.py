"""A reduced Pinocchio model becomes URDF text: the world, a link for each joint, frames, motors, simple shapes."""

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
import pinocchio

from pipeline.arrays import Floats
from pipeline.robot.importing.visuals import Body, add_body, add_bone, add_hand, add_materials
from pipeline.robot.pinocchio_model import joint_index, link_frame
from pipeline.urdf.bodies import inertia_attributes, possible, principal_moments, read_inertia
from pipeline.urdf.description import as_numbers, end_link, named

_ROUNDING = 1e-11  # of moments of inertia as they are written [kg m^2], or of the largest: more than it can be


def write_urdf(
    whole: Element, model: Any, *, joints: Sequence[str], frames: Sequence[str], hands: Mapping[str, str]
) -> str:
    """Write a model as the URDF of a robot.

    Parameters
    ----------
    whole : Element
        The URDF from which `model` was built, with its root link `world`; holds names, types, axes and limits.
    model : pinocchio.Model
        The model with no other joints than `joints`.
    joints : sequence of str
        Names, in the order in which they are written.
    frames : sequence of str
        Links of `whole` that stay: those of the hands, and the frame of the gaze.
    hands : mapping of str to str
        Names of the hands, by link.

    Returns
    -------
    str
        Numbers have 12 digits, so that machines whose last bits differ write the same text.
    """
    name = whole.get("name", "")
    robot = Element("robot", name=name)
    add_materials(robot, hands.values(), prefix=name)
    elements = named(whole, "joint")
    moved = {joint_index(model, joint): end_link(elements[joint], "child") for joint in joints}
    links = _write_links(robot, model, {0: "world"} | moved)
    for joint in joints:
        _write_joint(robot, elements[joint], model, links, prefix=name)
    for frame in dict.fromkeys(frames):
        _write_frame(robot, frame, model, links, prefix=name)
    for link, hand in hands.items():
        add_hand(named(robot, "link")[link], hand, prefix=name)
    for joint in joints:
        _write_motor(robot, joint)
    indent(robot)
    return f'<?xml version="1.0"?>\n{tostring(robot, encoding="unicode")}\n'


def _write_links(robot: Element, model: Any, names: Mapping[int, str]) -> dict[int, Element]:
    """Write the link that each joint moves, named by the joint's index; return the links by that index."""
    links = {index: SubElement(robot, "link", name=name) for index, name in names.items()}
    for index, link in links.items():
        inertia = model.inertias[index]
        if index == 0 or inertia.mass <= 0.0:  # what stands on the ground does not count
            continue
        body = Body(inertia.mass, inertia.lever, inertia.inertia)
        inertial = SubElement(link, "inertial")
        SubElement(inertial, "origin", xyz=as_numbers(body.centre), rpy="0 0 0")
        SubElement(inertial, "mass", value=as_numbers(body.mass))
        _write_inertia(inertial, body.inertia)
        add_body(link, body, prefix=robot.get("name", ""))
        if index not in set(model.parents):  # no joint to which a bone would lead
            add_bone(link, body.centre, prefix=robot.get("name", ""))
    return links


def _write_inertia(inertial: Element, inertia: Floats) -> None:
    """Write a body's inertia (3, 3) [kg m^2]; of a flat one, rounding must not make one that no body has."""
    element = SubElement(inertial, "inertia")
    for larger in (0.0, _ROUNDING * max(1.0, float(inertia.max()))):
        values = inertia_attributes(inertia + larger * np.eye(3))
        element.attrib.update({key: as_numbers(value) for key, value in values.items()})
        if possible(principal_moments(read_inertia(element))):
            return


def _write_joint(robot: Element, source: Element, model: Any, links: Mapping[int, Element], *, prefix: str) -> None:
    index = joint_index(model, source.get("name", ""))
    parent, pose = links[model.parents[index]], model.jointPlacements[index]
    joint = SubElement(robot, "joint", name=source.get("name", ""), type=source.get("type", ""))
    _write_origin(joint, pose, parent, links[index])
    joint.extend([*source.findall("axis"), *source.findall("limit")])
    add_bone(parent, pose.translation, prefix=prefix)


def _write_frame(robot: Element, name: str, model: Any, links: Mapping[int, Element], *, prefix: str) -> None:
    if name in named(robot, "link"):
        return
    frame = model.frames[link_frame(model, name)]
    parent = links[frame.parentJoint]
    joint = SubElement(robot, "joint", name=f"{name}_frame", type="fixed")
    _write_origin(joint, frame.placement, parent, SubElement(robot, "link", name=name))
    add_bone(parent, frame.placement.translation, prefix=prefix)


def _write_origin(joint: Element, pose: Any, parent: Element, child: Element) -> None:
    rpy = pinocchio.rpy.matrixToRpy(pose.rotation)
    SubElement(joint, "origin", xyz=as_numbers(pose.translation), rpy=as_numbers(rpy))
    SubElement(joint, "parent", link=parent.get("name", ""))
    SubElement(joint, "child", link=child.get("name", ""))


def _write_motor(robot: Element, joint: str) -> None:
    transmission = SubElement(robot, "transmission", name=f"{joint}_transmission")
    SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
    held = SubElement(transmission, "joint", name=joint)
    SubElement(held, "hardwareInterface").text = "hardware_interface/EffortJointInterface"
    SubElement(SubElement(transmission, "actuator", name=f"{joint}_motor"), "mechanicalReduction").text = "1"
