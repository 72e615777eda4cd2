"""Masses and inertias of a robot's links: those that no body can have are refused, and the link is named.

A simulator puts values of its own in their place, with no more than a warning; the robot would be another one.
"""

from collections.abc import Collection, Mapping
from xml.etree.ElementTree import Element

import numpy as np

from pipeline.arrays import Floats
from recorders.errors import RobotError
from recorders.text.wording import names_text

MAX_MASS_KG = 1e5  # of a link: beyond it are other units, or no number at all
MAX_MOMENT_KGM2 = 1e7  # likewise

_SLACK = 3e-15  # of moments of inertia [kg m^2], or of the largest: rounding only, and less than Drake allows
_PRODUCTS = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


def check_bodies(robot: Element, *, moved: Collection[str] = ()) -> None:
    """Check mass and inertia of every link of a parsed URDF; a link without <inertial> is a frame.

    Parameters
    ----------
    robot : Element
        The parsed URDF.
    moved : collection of str
        Links that a joint is to move, and whose mass cannot be 0.

    Raises
    ------
    RobotError
        A mass is negative, beyond `MAX_MASS_KG`, or 0 where a joint moves the link or it has moments of inertia; or
        the moments are those of no body: one is negative, or larger than the sum of the other two. The line names all
        such links.
    """
    if faults := body_faults(robot, moved=moved):
        raise RobotError(faults_text(faults))


def body_faults(robot: Element, *, moved: Collection[str] = ()) -> dict[str, str]:
    """Return what is wrong with mass and inertia, by link: of those that `check_bodies` refuses, in their order."""
    faults = {}
    for link in robot.iterfind("link"):
        if (inertial := link.find("inertial")) is not None:
            name = link.get("name", "")
            try:
                _check_body(f"link {name} of the URDF", inertial, moved=name in moved)
            except RobotError as error:
                faults[name] = str(error)
    return faults


def faults_text(faults: Mapping[str, str]) -> str:
    """Return one line for what is wrong with links: the first in full, the others by name."""
    first, *others = faults
    return faults[first] + (f"; other links that are no bodies: {names_text(others)}" if others else "")


def principal_moments(inertia: Floats) -> Floats:
    """Principal moments of an inertia (3, 3) [kg m^2], rising, shape (3,)."""
    return np.linalg.eigvalsh(inertia).astype(np.float64)


def possible(moments: Floats) -> bool:
    """Return whether a body can have these principal moments [kg m^2], rising, shape (3,); rounding aside."""
    low, middle, high = (float(moment) for moment in moments)
    slack = _SLACK * max(1.0, high)
    return low >= -slack and low + middle + slack >= high


def read_inertia(element: Element) -> Floats:
    """Return the matrix (3, 3) of an <inertia> [kg m^2], as it stands."""
    matrix = np.empty((3, 3))
    for key, (row, column) in _PRODUCTS.items():
        matrix[row, column] = matrix[column, row] = float(element.get(key, "0"))
    return matrix


def inertia_attributes(matrix: Floats) -> dict[str, float]:
    """Return the attributes of an <inertia> for a matrix (3, 3) [kg m^2]."""
    return {key: float(matrix[place]) for key, place in _PRODUCTS.items()}


def _check_body(where: str, inertial: Element, *, moved: bool) -> None:
    mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
    if mass_element is None or inertia_element is None:
        missing = "mass" if mass_element is None else "inertia"
        raise RobotError(f"{where}: expected <inertial> to hold <mass> and <inertia>, found no <{missing}>")
    mass, inertia = float(mass_element.get("value", "")), read_inertia(inertia_element)
    if mass == 0.0 and moved:
        raise RobotError(
            f"{where}: expected a mass above 0, as a joint moves it, found 0; a mere frame has no <inertial>"
        )
    if not 0.0 <= mass <= MAX_MASS_KG:
        expected = "above 0" if mass < 0.0 else f"of at most {MAX_MASS_KG:g} kg"
        raise RobotError(f"{where}: expected a mass {expected}, found {mass:g}")
    if mass == 0.0 and inertia.any():
        raise RobotError(f"{where}: expected no moments of inertia where the mass is 0, found {inertia.max():g}")
    if not (largest := float(np.abs(inertia).max())) <= MAX_MOMENT_KGM2:
        expected = f"expected moments of inertia of at most {MAX_MOMENT_KGM2:g} kg m^2"
        raise RobotError(f"{where}: {expected}, found {largest:g}")
    if not possible(moments := principal_moments(inertia)):
        found = ", ".join(f"{moment:.6g}" for moment in moments)
        raise RobotError(
            f"{where}: expected the inertia of a body, with no principal moment below 0 or above the sum of the "
            f"other two, found {found} kg m^2"
        )
