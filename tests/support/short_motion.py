"""A motion for tests that drive a robot over the network: three samples, so that a session takes seconds."""

from pathlib import Path

import numpy as np

from pipeline.robot.config import load_robot


def write_short_motion(path: Path) -> Path:
    """Write a motion of three samples at 10 Hz: both hands move a little to and fro."""
    robot = load_robot("asimo")
    rows = ["t,lx,ly,lz,rx,ry,rz"]
    for sample, lift in enumerate((0.0, 0.02, 0.0)):
        up = np.array([0.0, 0.0, lift])
        hands = np.concatenate([robot.centres[0] + up, robot.centres[1] + up]).tolist()
        rows.append(",".join(map(repr, [0.1 * sample, *hands])))
    path.write_text("\n".join(rows))
    return path
