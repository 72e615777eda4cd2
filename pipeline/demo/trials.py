"""Motions that every controller of the demo is tried on."""

from pathlib import Path

from pipeline.evaluation.trials import Trial, evaluate_motion
from pipeline.learner.controller import Controller

DRAWING = "right_hand_drawing"
"""Stands for the user's demonstration; generated, see its file."""

Trials = tuple[Trial, Trial, Trial]


def try_motions(controller: Controller, patterns: list[Path]) -> Trials:
    """Try a controller on the logs of pattern 1 and pattern 2, and on the drawing, in this order."""
    first, second = patterns
    return (
        evaluate_motion(controller, first),
        evaluate_motion(controller, second),
        evaluate_motion(controller, DRAWING),
    )
