"""Why the errors are what they are: taken apart by direction, and followed through the training."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.motions import PATTERNS
from pipeline.paper_results import PATTERN_1, Networks, Paper
from pipeline.robot import RobotConfig

Floats = NDArray[np.float64]

_CM_PER_M = 100.0


@dataclass(frozen=True)
class Direction:
    """How far hands move, and miss, in one direction of the plane, both hands together [cm, root mean square].

    Attributes
    ----------
    name : what the direction is
    pattern_1_cm, pattern_2_cm : how far the targets of each pattern spread about their centres
    missed_cm : by the pattern that the networks learned, how far their hands miss pattern 1
    """

    name: str
    pattern_1_cm: float
    pattern_2_cm: float
    missed_cm: Mapping[str, float]


def directions(paper: Paper) -> list[Direction]:
    """Take motions and errors apart: what pattern 2 never shows is what its networks cannot do."""
    targets = [paper.networks[PATTERN_1].trials[name][0].targets.reshape(-1, 2, 3) for name in PATTERNS]
    spreads = [_parts(motion - motion.mean(axis=0), paper.robot) for motion in targets]
    missed = {
        pattern: np.mean(
            [_parts(trial.reached - targets[0], paper.robot) for trial in networks.trials[PATTERN_1]], axis=0
        )
        for pattern, networks in paper.networks.items()
    }
    names = ("sideways, both hands alike", "sideways, hands apart and together", "up and down, each hand")
    return [
        Direction(name, float(one), float(two), {pattern: float(parts[i]) for pattern, parts in missed.items()})
        for i, (name, one, two) in enumerate(zip(names, *spreads, strict=True))
    ]


def _parts(offsets: Floats, robot: RobotConfig) -> Floats:
    """Root mean square [cm] of offsets [m] (T, 2, 3): sideways alike, sideways opposed, up and down; shape (3,)."""
    sideways, up = offsets @ robot.lateral, offsets @ robot.up  # (T, 2)
    alike, opposed = sideways.sum(axis=1) / 2.0, (sideways[:, 0] - sideways[:, 1]) / 2.0
    return _CM_PER_M * np.array([np.sqrt(np.square(part).mean()) for part in (alike, opposed, up)])


@dataclass(frozen=True)
class Depth:
    """How far hands miss a motion within the plane of the pictures, and ahead of or behind it [cm, mean].

    Attributes
    ----------
    motion, hand : what is done, and "left" or "right"
    in_plane_cm, off_plane_cm : distance from the target within the plane, and from the plane
    """

    motion: str
    hand: str
    in_plane_cm: float
    off_plane_cm: float


def depths(paper: Paper, networks: Networks) -> list[Depth]:
    """Say of every motion and hand what pictures of the plane do not show, as a mean over networks."""
    axes = np.stack([paper.robot.lateral, paper.robot.up], axis=1)  # (3, 2)
    ahead = np.cross(paper.robot.lateral, paper.robot.up)
    found = []
    for name, trials in networks.trials.items():
        offsets = np.array([trial.reached - trial.targets.reshape(-1, 2, 3) for trial in trials])  # (networks, T, 2, 3)
        in_plane_m = np.linalg.norm(offsets @ axes, axis=3).mean(axis=(0, 1))  # (2,)
        off_plane_m = np.abs(offsets @ ahead).mean(axis=(0, 1))
        for place, hand in enumerate(("left", "right")):
            found.append(Depth(name, hand, _CM_PER_M * in_plane_m[place], _CM_PER_M * off_plane_m[place]))
    return found


def turning_point(networks: Networks) -> tuple[int, float] | None:
    """Epoch, from 1, in which the mean error was least, and that error [cm]; None if it fell to the end."""
    mean_cm = networks.curves_cm.mean(axis=0)
    least = int(np.argmin(mean_cm))
    return None if least == mean_cm.size - 1 else (least + 1, float(mean_cm[least]))
