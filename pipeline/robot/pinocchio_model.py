"""Pinocchio's model of a robot: the one place where it is given a URDF, and asked by name."""

from typing import Any
from xml.etree.ElementTree import Element, tostring

import pinocchio

from pipeline.urdf.model_names import for_libraries, joint_name, link_name
from recorders.errors import RobotError
from recorders.text.wording import line_text

_LINK = pinocchio.FrameType.BODY


def build_model(urdf: Element) -> Any:
    """Build the `pinocchio.Model` of a parsed URDF.

    Raises
    ------
    RobotError
        Pinocchio cannot build it.
    """
    try:
        return pinocchio.buildModelFromXML(_text(urdf))
    except (RuntimeError, ValueError) as error:
        raise RobotError(f"the URDF does not build: {line_text(str(error), limit=1000)}") from error


def build_shapes(model: Any, urdf: Element) -> Any:
    """Build the `pinocchio.GeometryModel` of what is seen of a robot, with the model of the same URDF."""
    return pinocchio.buildGeomFromUrdfString(model, _text(urdf), pinocchio.GeometryType.VISUAL)


def joint_index(model: Any, name: str) -> int:
    """Return the index of a joint in a model of this module."""
    return int(model.getJointId(joint_name(name)))


def link_frame(model: Any, name: str) -> int:
    """Return the index of a link's frame in a model of this module."""
    return int(model.getFrameId(link_name(name), _LINK))


def _text(urdf: Element) -> str:
    return tostring(for_libraries(urdf), encoding="unicode")
