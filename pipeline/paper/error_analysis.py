"""Why the errors are what they are: taken apart by direction, and followed through the training."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats
from pipeline.motions.names import PATTERNS
from pipeline.paper.results import PATTERN_1, NetworkEnsemble, PaperResults
from pipeline.robot.config import RobotConfig

ALIKE, APART, UPRIGHT = "sideways, both hands alike", "sideways, hands apart and together", "up and down, each hand"

_CM_PER_M = 100.0


@dataclass(frozen=True)
class Direction:
    """Motion and error of the hands in one direction of the plane, both hands together [cm, root mean square].

    Attributes
    ----------
    name : str
        What the direction is.
    pattern_1_cm, pattern_2_cm : float
        How far the targets of each pattern spread about their centres.
    missed_cm : mapping of str to float
        By the pattern that the networks learned, how far their hands miss pattern 1.
    followed : mapping of str to float
        By the same, the part of pattern 1's movement in this direction that their hands follow; 1 is all of it.
    """

    name: str
    pattern_1_cm: float
    pattern_2_cm: float
    missed_cm: Mapping[str, float]
    followed: Mapping[str, float]


def directions(paper: PaperResults) -> list[Direction]:
    """Take motions and errors apart: what pattern 2 never shows is what its networks cannot do."""
    one, two = (_moved(paper.networks[PATTERN_1].trials[name][0].targets, paper.robot) for name in PATTERNS)
    reached = {
        pattern: [_moved(trial.reached, paper.robot) for trial in networks.trials[PATTERN_1]]
        for pattern, networks in paper.networks.items()
    }
    return [
        Direction(
            name,
            pattern_1_cm=float(np.std(one[name])),
            pattern_2_cm=float(np.std(two[name])),
            missed_cm={
                pattern: _mean(_rms(hands[name] - one[name]) for hands in all_) for pattern, all_ in reached.items()
            },
            followed={
                pattern: _mean(_slope(one[name], hands[name]) for hands in all_) for pattern, all_ in reached.items()
            },
        )
        for name in (ALIKE, APART, UPRIGHT)
    ]


def _moved(positions: Floats, robot: RobotConfig) -> dict[str, Floats]:
    """Take positions of both hands [m], shape (T, 6) or (T, 2, 3), apart by direction [cm], each about its centre."""
    hands = _CM_PER_M * positions.reshape(-1, 2, 3)
    centres = _CM_PER_M * robot.centres
    sideways, up = (hands - centres) @ robot.lateral, (hands - centres) @ robot.up  # (T, 2)
    return {ALIKE: sideways.sum(axis=1) / 2.0, APART: (sideways[:, 0] - sideways[:, 1]) / 2.0, UPRIGHT: up}


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.square(values).mean()))


def _slope(asked: Floats, done: Floats) -> float:
    """Slope of the line through what was done over what was asked; 0 where nothing was asked."""
    varied = asked - asked.mean()
    square = float(np.square(varied).sum())
    return float((varied * done).sum()) / square if square > 0.0 else 0.0


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


@dataclass(frozen=True)
class Depth:
    """Error of the hands within the plane of the pictures, and ahead of or behind it [cm, mean].

    Attributes
    ----------
    motion, hand : str
        What is done, and "left" or "right".
    out_cm : float
        How far its targets are at most from the centre of that hand's pattern.
    missed_cm : float
        Distance from the target.
    in_plane_cm, off_plane_cm : float
        The same within the plane, and ahead of it or behind.
    """

    motion: str
    hand: str
    out_cm: float
    missed_cm: float
    in_plane_cm: float
    off_plane_cm: float


def depths(paper: PaperResults, networks: NetworkEnsemble) -> list[Depth]:
    """Return, for every motion and hand, the depth that pictures of the plane do not show, as a mean over networks."""
    robot = paper.robot
    axes = np.stack([robot.lateral, robot.up], axis=1)  # (3, 2)
    ahead = np.cross(robot.lateral, robot.up)
    found = []
    for name, trials in networks.trials.items():
        targets = trials[0].targets.reshape(-1, 2, 3)
        offsets = np.array([trial.reached - targets for trial in trials])  # (networks, T, 2, 3)
        for index, (hand, centre) in enumerate(zip(robot.hand_names, robot.centres, strict=True)):
            out_m = np.linalg.norm(targets[:, index] - centre, axis=1).max()
            missed = offsets[:, :, index]  # (networks, T, 3)
            parts_m = [np.linalg.norm(missed, axis=2), np.linalg.norm(missed @ axes, axis=2), np.abs(missed @ ahead)]
            found.append(Depth(name, hand, _CM_PER_M * float(out_m), *(_CM_PER_M * float(p.mean()) for p in parts_m)))
    return found


def turning_point(networks: NetworkEnsemble) -> tuple[int, float] | None:
    """Epoch, from 1, in which the mean error was least, and that error [cm]; None if it fell to the end."""
    mean_cm = networks.curves_cm.mean(axis=0)
    least = int(np.argmin(mean_cm))
    return None if least == mean_cm.size - 1 else (least + 1, float(mean_cm[least]))
