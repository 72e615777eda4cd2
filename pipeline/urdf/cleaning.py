"""Leaves of a URDF what the program needs: bodies, joints, motors and simple shapes, and nothing that names a file.

What is left out are meshes and textures, which libraries would open wherever they lie, and all that libraries read in
ways of their own: simulators' extensions, calibration, soft limits.
"""

from collections.abc import Iterable, Mapping
from xml.etree.ElementTree import Element

# What each element may hold, by its path below the robot; True: more than once.
_CHILDREN: Mapping[str, Mapping[str, bool]] = {
    "": {"link": True, "joint": True, "transmission": True, "material": True},
    "link": {"inertial": False, "visual": True, "collision": True},
    "link/inertial": {"origin": False, "mass": False, "inertia": False},
    "link/visual": {"origin": False, "geometry": False, "material": False},
    "link/visual/geometry": {"box": False, "cylinder": False, "sphere": False},
    "link/visual/material": {"color": False},
    "link/collision": {"origin": False, "geometry": False},
    "link/collision/geometry": {"box": False, "cylinder": False, "sphere": False},
    "joint": dict.fromkeys(("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"), False),
    "transmission": {"type": False, "joint": True, "actuator": True},
    "transmission/joint": {"hardwareInterface": True},
    "transmission/actuator": {"hardwareInterface": True, "mechanicalReduction": False},
    "material": {"color": False},
}
_ATTRIBUTES: Mapping[str, tuple[str, ...]] = {
    "link": ("name",),
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "material": ("name",),
    "color": ("rgba",),
    "joint": ("name", "type"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction"),
    "mimic": ("joint", "multiplier", "offset"),
    "transmission": ("name",),
    "actuator": ("name",),
}
_TEXTS = frozenset({"type", "hardwareInterface", "mechanicalReduction"})


def cleaned(robot: Element) -> Element:
    """Return a copy of a URDF without what the program does not need, kind by kind."""
    clean = _copy(robot, "")
    clean.set("name", robot.get("name", ""))
    for link in clean.iterfind("link"):
        _drop(link, [shape for kind in ("visual", "collision") for shape in link.iterfind(kind) if not _drawn(shape)])
    _clean_materials(clean)
    for joint in clean.iterfind("joint"):
        _drop(joint, [element for tag in ("axis", "dynamics") for element in joint.iterfind(tag) if not element.attrib])
        if joint.get("type") == "fixed":
            _drop(joint, joint.findall("mimic"))
    _clean_transmissions(clean)
    return clean


def _copy(element: Element, path: str) -> Element:
    names = _ATTRIBUTES.get(element.tag, ())
    copy = Element(element.tag, {name: value for name, value in element.attrib.items() if name in names})
    if element.tag in _TEXTS:
        copy.text = element.text
    for tag, many in _CHILDREN.get(path, {}).items():  # kind by kind: Rerun reads no others between two of one kind
        children = element.findall(tag)
        copy.extend(_copy(child, f"{path}/{tag}".lstrip("/")) for child in (children if many else children[:1]))
    return copy


def _drawn(shape: Element) -> bool:
    """Return whether it is a shape that needs no file."""
    geometry = shape.find("geometry")
    return geometry is not None and len(geometry) == 1


def _clean_materials(robot: Element) -> None:
    """Leave one material of each name that a shape refers to, and references to these; others have no colour."""
    shown = {material.get("name") for material in robot.iterfind("link/visual/material")}
    known: dict[str, Element] = {}
    for material in robot.iterfind("material"):
        if len(material) and (name := material.get("name", "")) in shown:
            known.setdefault(name, material)
    _keep(robot, "material", known.values())
    for visual in robot.iterfind("link/visual"):
        materials = visual.findall("material")
        _drop(visual, [one for one in materials if not one.get("name") or not (len(one) or one.get("name") in known)])


def _clean_transmissions(robot: Element) -> None:
    """Leave the simple motors of joints that move; models have some of joints that are rigid."""
    moving = {joint.get("name") for joint in robot.iterfind("joint") if joint.get("type") != "fixed"}
    simple = [motor for motor in robot.iterfind("transmission") if "SimpleTransmission" in motor.findtext("type", "")]
    _keep(
        robot,
        "transmission",
        [motor for motor in simple if {joint.get("name") for joint in motor.iterfind("joint")} <= moving],
    )


def _keep(robot: Element, kind: str, wanted: Iterable[Element]) -> None:
    """Leave of one kind only these."""
    robot[:] = [*(element for element in robot if element.tag != kind), *wanted]


def _drop(parent: Element, children: Iterable[Element]) -> None:
    for child in children:
        parent.remove(child)
