"""Explores and learns as the demo does and prints digests, beside bits that do depend on the machine; run as a script.

The arguments: `demo` for all of it, or `short` for a few samples and one epoch; then a folder.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

from exactness import controls


def main() -> None:
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from pipeline.exploration.explore import explore
    from pipeline.learner.rules.reservoir.config import LearnerConfig
    from pipeline.motions.motion import Motion, load_motion
    from pipeline.robot.config import load_robot
    from pipeline.robot.resolution import UNLIMITED
    from pipeline.training.trainer import train
    from replay.sources.schedule import Schedule

    length, folder = sys.argv[1], Path(sys.argv[2])
    robot = load_robot("asimo")
    motions = {name: load_motion(name, robot) for name in ("circles", "eight")}
    epochs = 150
    if length == "short":
        whole = motions["circles"]
        motions = {"circles": Motion("circles", whole.times_s[:6], whole.targets[:6], closed=False)}
        epochs = 1
    paths = [folder / f"{name}.mcap" for name in motions]
    explored = [explore(robot, m, seed=0, out=path) for m, path in zip(motions.values(), paths, strict=True)]
    digests = {path.name: result.content_sha256 for path, result in zip(paths, explored, strict=True)}
    trained = train(paths[:1], schedule=Schedule(epochs=epochs), config=LearnerConfig(seed=0)).result()
    digests["controller.npz"] = str(trained["digest"])
    if length == "demo":
        digests |= of_deployables(folder)
    last = motions[paths[-1].stem]
    unrounded = explore(replace(robot, resolution=UNLIMITED), last, seed=0, out=folder / "unrounded.mcap")
    print(json.dumps({"digests": digests, "controls": {**controls(), "unrounded": unrounded.content_sha256}}))


def of_deployables(folder: Path) -> dict[str, str]:
    """Explore the volume with the teacher and without, learn both, and return the digests by file."""
    from pipeline.demo.deployables import CONTROLLERS, DURATION_S, LOGS, RULE
    from pipeline.exploration.explore import explore
    from pipeline.exploration.source import self_exploration, source
    from pipeline.learner.registry import default_config
    from pipeline.robot.config import load_robot
    from pipeline.training.trainer import train

    robot, config, digests = load_robot("asimo"), default_config(RULE, seed=0), dict[str, str]()
    sources = (source("volume", duration_s=DURATION_S), self_exploration(duration_s=DURATION_S))
    for led, log, controller in zip(sources, LOGS, CONTROLLERS, strict=True):
        found = explore(
            robot,
            led.motion(robot, seed=0),
            seed=0,
            out=folder / log,
            config=led.config,
            guidance=led.guidance(robot, seed=0),
        )
        trained = train([folder / log], schedule=config.schedule(), config=config).result()
        digests |= {log: found.content_sha256, controller: str(trained["digest"])}
    return digests


if __name__ == "__main__":
    main()
