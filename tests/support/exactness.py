"""Trains on a small log and prints its digests, and beside them bits that do depend on the machine; run as a script."""

import hashlib
import json
import math
import sys
from pathlib import Path

import numba
import numpy as np


def bits(values: object) -> str:
    return hashlib.sha256(np.ascontiguousarray(values, dtype="<f8").tobytes()).hexdigest()[:16]


@numba.njit(fastmath=True)
def reordered_sum(values: np.ndarray) -> float:
    total = 0.0
    for value in values:
        total += value * 0.1
    return total


def controls() -> dict[str, str]:
    """Return bits that are free to change with the machine: each shows that a row of the matrix reached its code."""
    values = np.random.default_rng(0).standard_normal(200_000)
    square = values[:160_000].reshape(400, 400)
    return {
        "libm": bits([[math.sin(v), math.exp(v), math.pow(abs(v), 0.3)] for v in values[:20_000].tolist()]),
        "numpy": bits(np.tanh(np.sin(values))),
        "compiler": bits([reordered_sum(values[i:]) for i in range(64)]),
        "blas": bits(square @ square),
        "dot": bits([np.dot(values[i:], values[: len(values) - i]) for i in range(64)]),
    }


def aligned_training(log: Path) -> list[str]:
    """Return the digests of a training on ticks between those of the log."""
    from pipeline.alignment.align import align_logs
    from pipeline.alignment.config import AlignmentConfig
    from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
    from pipeline.training.trainer import Trainer, train_on
    from recorders.messages.topics import LEFT_MEASURED, RIGHT_MEASURED, SAMPLE_JOINTS
    from replay.sources.schedule import Schedule
    from replay.sources.scheduled import Replay

    topics = (LEFT_MEASURED, RIGHT_MEASURED, SAMPLE_JOINTS)
    config = AlignmentConfig(period_ns=33_333_333, tolerance_ns=300_000_000)
    ticks, _ = align_logs([log], config, robot=None, renames={}, tick=topics)
    trainer = train_on(Replay(ticks, Schedule(epochs=2, topics=topics)), Trainer(ForwardInverseConfig()))
    result = trainer.result()
    return [str(result["digest"]), str(result["stream_digest"])]


def aligned_poses() -> str:
    """Return a digest of poses between those of a tracker that turns about all axes."""
    from pipeline.alignment.blocks import pose_kind
    from pipeline.alignment.config import AlignmentConfig
    from pipeline.alignment.frames import StaticFrames
    from pipeline.alignment.rows import RowFormat
    from pipeline.alignment.ticks import Aligner, Source
    from recorders.cdr.codec import encode
    from recorders.messages.message_types import PoseStamped
    from recorders.messages.record import RecordedMessage
    from recorders.messages.topics import LEFT_MEASURED

    frame, period_ns = (0.5, -0.25, 1.0, 0.5, 0.1, -0.25, 1.0), 7_000_001
    sources = (Source("/tracker", LEFT_MEASURED, pose_kind()),)
    config, frames = AlignmentConfig(frames={"/tracker": frame}), StaticFrames(["", "world"])
    aligner = Aligner(sources, config, period_ns=period_ns, pivot=0, frames=frames)
    records = []
    for index, numbers in enumerate(np.random.default_rng(3).random((500, 7)) - 0.5):
        stamp = 10**9 + index * 33_333_333
        message = PoseStamped(stamp, numbers[:3], orientation=numbers[3:], frame_id="camera")
        records.append(RecordedMessage("/tracker", message.TYPE, encode(message), index, stamp))
    rows = b"".join(RowFormat(sources, ()).rows(ticks) for ticks in aligner.feed(records))
    assert aligner.made > 2000
    return hashlib.sha256(rows).hexdigest()


def main() -> None:
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
    from pipeline.learner.rules.reservoir.config import LearnerConfig
    from pipeline.training.trainer import train
    from replay.sources.schedule import Schedule

    quadratic = ForwardInverseConfig(degree=2, forgetting=0.99)
    runs = (LearnerConfig(seed=0), None), (ForwardInverseConfig(), None), (quadratic, None), (quadratic, "computed")
    log, schedule = Path(sys.argv[1]), Schedule(epochs=2)
    results = [train([log], schedule=schedule, config=config, pairs=pairs).result() for config, pairs in runs]
    digests = [result[name] for result in results for name in ("digest", "stream_digest")]
    digests += [*aligned_training(log), aligned_poses()]
    print(json.dumps({"digests": digests, "controls": controls()}))


if __name__ == "__main__":
    main()
