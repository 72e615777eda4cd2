"""The command line, `reenact`: puts the verbs together and turns errors into one line and an exit status."""

import signal
import sys
from types import FrameType
from typing import Any

import typer

from pipeline import console
from pipeline.printable import printable
from pipeline.verbs import demonstrating, exploring, golden, logs, network, offline, paper, recording, serving, viewing
from recorders.errors import ReenactError

app = typer.Typer(
    name="reenact",
    help="Record a robot, replay the recording, learn from it, deploy what was learned, and prove it still works.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

app.command(epilog="Example: reenact demo --out out/demo")(offline.demo)
app.command(epilog="Example: reenact explore --motion circles --robot asimo --seed 0 --out circles.mcap")(
    exploring.explore
)
app.command(epilog="Example: reenact demonstrate right_hand_house --out house.mcap")(demonstrating.demonstrate)
app.command(epilog="Example, then: reenact explore --connect tcp/127.0.0.1:7447 --motion eight")(exploring.robot)
app.command(epilog="Example: reenact record --out session.mcap --exclude /tf")(recording.record)
app.command(epilog="Example: reenact train circles.mcap --out controller.npz")(offline.train)
app.command(epilog="Example, in a second terminal: reenact replay circles.mcap --epochs 150")(network.learn)
app.command(epilog="Example, in a second terminal: reenact learn --out controller.npz")(network.replay)
app.command(epilog="Example: reenact serve controller.npz --record served.mcap")(serving.serve)
app.command(epilog="Example: reenact evaluate controller.npz eight --json")(offline.evaluate)
app.command(epilog="Example: reenact diff recorded.mcap replayed.mcap")(offline.diff)
app.command(epilog="Example: reenact info session.mcap")(logs.info)
app.command(epilog="Example: reenact recover session.mcap.part --out recovered.mcap")(logs.recover)
app.command(epilog="Example: reenact paper --out out/paper")(paper.paper)
app.command(epilog="Example: reenact view controller.npz --save controller.rrd")(viewing.view)
app.add_typer(golden.app)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line: status 0 done and holds, 1 a check failed, 2 bad usage or bad input."""
    signal.signal(signal.SIGTERM, _terminate)
    # What click raises on bad usage; typer carries click within itself and exports only this subclass.
    usage_error: Any = typer.BadParameter.__bases__[0]
    try:
        status = app(arguments, standalone_mode=False)
    except ReenactError as error:
        _fail(str(error), error.exit_status)
    except typer.Abort:
        sys.exit(130)
    except OSError as error:
        _fail(f"{error.filename or 'system'}: {error.strerror or error}", 2)
    except usage_error as error:
        _fail(f"{error.format_message()} (reenact --help shows what there is)", 2)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(line: str, status: int) -> None:
    console.say(f"reenact: {printable(' '.join(line.split()))}")
    sys.exit(status)


def _terminate(signum: int, frame: FrameType | None) -> None:
    """Turn SIGTERM into an exception, so that every open file and session is finished on the way out."""
    sys.exit(128 + signum)
