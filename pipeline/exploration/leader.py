"""Leaders of an exploration by their settings: either teacher, or the learner that explores by itself."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, TypeAlias

from pipeline.exploration.episode import Guide
from pipeline.exploration.self_explorer import SelfExplorer, SelfExplorerConfig
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.qp_config import QpTeacherConfig
from pipeline.teacher.teacher import Teacher, TeacherConfig

TEACHERS = ("rates", "qp")
"""The teachers: resolved rates, and Drake's differential inverse kinematics as a quadratic program."""

Leader: TypeAlias = TeacherConfig | QpTeacherConfig | SelfExplorerConfig

_KEYS: dict[str, type[Leader]] = {
    "teacher": TeacherConfig,
    "qp_teacher": QpTeacherConfig,
    "self_explorer": SelfExplorerConfig,
}


def leader_settings(leader: Leader) -> dict[str, Any]:
    """Return the entry of a manifest that names who leads, and how."""
    (key,) = [key for key, kind in _KEYS.items() if isinstance(leader, kind)]
    return {key: asdict(leader)}


def leader_of(manifest: Mapping[str, Any]) -> Leader:
    """Return the leader of an exploration.

    Raises
    ------
    KeyError, TypeError, ConfigError
        The manifest names nobody, or with settings that are none.
    """
    key = next((key for key in reversed(_KEYS) if key in manifest), "teacher")
    return _KEYS[key](**manifest[key])


def make_guide(robot: RobotConfig, leader: Leader, *, seed: int) -> Guide:
    """Return who leads a robot; the seed is that of the exploration."""
    if isinstance(leader, SelfExplorerConfig):
        return SelfExplorer(robot, seed=seed, config=leader)
    if isinstance(leader, QpTeacherConfig):
        from pipeline.teacher.qp_teacher import QpTeacher  # noqa: PLC0415  # Drake: the others do without

        return QpTeacher(robot, leader)
    return Teacher(Kinematics(robot), leader)
