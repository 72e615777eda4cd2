"""Names of links and joints as libraries are given them: no link can be taken for a joint, or for something of theirs.

URDFs may call a joint as they call a link. Libraries look some things up among both, and make frames with names of
their own. So each name goes in with what it names before it; the ground alone is called as everywhere.
"""

from copy import deepcopy
from xml.etree.ElementTree import Element

from pipeline.urdf.description import WORLD


def joint_name(name: str) -> str:
    """Return what a joint is called for libraries."""
    return f"joint {name}"


def link_name(name: str) -> str:
    """Return what a link is called for libraries."""
    return name if name == WORLD else f"link {name}"


def for_libraries(urdf: Element) -> Element:
    """Return a copy of a parsed URDF with names for libraries, in the same order."""
    renamed = deepcopy(urdf)
    for link in renamed.iterfind("link"):
        link.set("name", link_name(link.get("name", "")))
    for joint in (*renamed.iterfind("joint"), *renamed.iterfind("transmission/joint")):
        joint.set("name", joint_name(joint.get("name", "")))
    for end in (*renamed.iterfind("joint/parent"), *renamed.iterfind("joint/child")):
        end.set("link", link_name(end.get("link", "")))
    return renamed
