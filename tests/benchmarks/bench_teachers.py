"""The two teachers side by side on the simulated robot: python tests/benchmarks/bench_teachers.py [SECONDS].

Both explore the circles, a drawing and random points in the hands' boxes (SECONDS of it, 20 by default), in Drake, with
the settings of `explore`. The columns are those of `pipeline.paper.comparison.teachers.TeacherTrial`; the report
of `reenact paper` has the same table. Nothing is asserted.
"""

import sys
import tempfile
from pathlib import Path

from pipeline.exploration.leader import TEACHERS
from pipeline.exploration.via_points import VOLUME
from pipeline.paper.comparison.teachers import TAUGHT_MOTIONS, TeacherTrial, try_teacher


def row(trial: TeacherTrial) -> str:
    near = "none" if trial.self_distance_cm is None else f"{trial.self_distance_cm:.2f}"
    return (
        f"{trial.motion:20s}{trial.teacher:8s}{trial.error_cm:10.3f}{trial.limit_margin:z9.3f}{trial.joint_speed:8.2f}"
        f"{trial.comfort:10.4f}{near:>13s}{trial.step_us:8.0f}"
    )


def main() -> None:
    lengths = {**TAUGHT_MOTIONS, VOLUME: float(sys.argv[1]) if sys.argv[1:] else TAUGHT_MOTIONS[VOLUME]}
    print(f"{'':28s}{'error cm':>10s}{'margin':>9s}{'speed':>8s}{'comfort':>10s}{'distance cm':>13s}{'us':>8s}")
    with tempfile.TemporaryDirectory() as folder:
        for name, duration_s in lengths.items():
            for teacher in TEACHERS:
                trial = try_teacher(
                    teacher, name, robot_name="asimo", seed=0, folder=Path(folder), duration_s=duration_s
                )
                print(row(trial), flush=True)


if __name__ == "__main__":
    main()
