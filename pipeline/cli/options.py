"""Options that several verbs share, and the parsing of their values."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.motions.names import motion_names
from pipeline.resources import data_path
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.learner.rule import Settings

MOTIONS = ", ".join(motion_names())
"""The motions that come with the program, for the help."""


def complete_motion(incomplete: str) -> list[str]:
    """Return the motions whose names begin so, for the shell."""
    from pipeline.motions.motion import MOTIONS as REGISTERED

    return [name for name in dict.fromkeys((*motion_names(), *REGISTERED.names())) if name.startswith(incomplete)]


def complete_robot(incomplete: str) -> list[str]:
    """Return the robots whose names begin so, for the shell."""
    return sorted(folder.name for folder in data_path("robots").glob(f"{incomplete}*/"))


Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")]
Seed = Annotated[int, typer.Option(help="Seed of every random draw.", min=0, metavar="N")]
Rule = Annotated[
    str | None,
    typer.Option("--rule", help="Learning rule: reservoir if left out.", metavar="RULE"),
]
Pairs = Annotated[
    str | None,
    typer.Option(
        "--pairs", help="Pairs to learn from, commanded, reached or computed: the rule's if left out.", metavar="PAIRS"
    ),
]
LearnerFile = Annotated[
    Path | None, typer.Option("--config", help="Settings of the learner, seed included (TOML).", metavar="FILE")
]
Epochs = Annotated[int, typer.Option(help="Epochs of training: 150 for circles, 600 for eight.", min=1, metavar="N")]
Logs = Annotated[list[Path], typer.Argument(help="Logs or bags, presented in this order.", metavar="LOG.mcap")]
Controller = Annotated[Path, typer.Argument(help="A learned controller.", metavar="CONTROLLER.npz")]
Robot = Annotated[
    str,
    typer.Option(
        help="Robot that comes with the program, or a folder of one.", metavar="ROBOT", autocompletion=complete_robot
    ),
]
StreamsRobot = Annotated[
    str | None, typer.Option(help="Robot; by default the one that the stream or log names.", metavar="ROBOT")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the file; a crash's .part is set aside.")]
AsRecorded = Annotated[bool, typer.Option("--as-recorded", help="Follow the phase markers of a recorded session.")]
AsLive = Annotated[bool, typer.Option("--as-live", help="Take the messages as `learn --live` would have taken them.")]
Renames = Annotated[
    list[str] | None, typer.Option("--map", help="FOREIGN=OURS: rename a topic.", metavar="FOREIGN=OURS")
]


def learner_settings(
    config: Path | None, rule: str | None, pairs: str | None, seed: int
) -> "tuple[Settings, str | None]":
    """Return the settings of a learner and its pairs, as options or a file name them.

    Raises
    ------
    ConfigError
        If the file cannot be read, a setting is wrong, or it and an option name different things.
    """
    from pipeline.golden.own_settings import pairs_of, read_settings, without_pairs
    from pipeline.learner.registry import default_config

    if config is None:
        return default_config(rule, seed=seed), pairs
    if seed:
        raise ConfigError(f"--seed: expected none beside --config, whose file has the seed, found {seed}")
    settings = read_settings(config, rule=rule, pairs=pairs)
    return without_pairs(settings), pairs_of(settings)


def renames(pairs: list[str] | None) -> dict[str, str]:
    """Parse FOREIGN=OURS pairs.

    Raises
    ------
    ConfigError
        If one is not such a pair, or a topic is named twice.
    """
    found: dict[str, str] = {}
    for pair in pairs or ():
        foreign, equals, ours = pair.partition("=")
        if not (foreign and equals and ours) or foreign in found:
            raise ConfigError(f"--map: expected FOREIGN=OURS, each topic once, found {pair!r}")
        found[foreign] = ours
    return found
