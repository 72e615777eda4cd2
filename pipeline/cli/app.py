"""The command line, `reenact`: puts the verbs together and turns errors into one line and an exit status."""

import importlib.metadata
import sys
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from pipeline.cli import demo_train_evaluate_diff, golden, info_recover, learn_replay, paper, status
from pipeline.cli import demonstrate as demonstrating
from pipeline.cli import explore as exploring
from pipeline.cli import record as recording
from pipeline.cli import serve as serving
from pipeline.cli import view as viewing
from pipeline.cli.interrupts import words
from pipeline.cli.options import help_without_verb
from pipeline.cli.usage import Verbs, usage_line
from pipeline.extras import missing_extra
from pipeline.terminal import console
from pipeline.terminal.escaping import printable
from pipeline.terminal.signals import end_by_exceptions
from recorders.errors import ReenactError
from recorders.text.wording import line_text


class _Program(TyperGroup):
    """Ends with a line where a signal cut a verb short: click itself ends without a word after Ctrl-C."""

    def invoke(self, ctx: Any) -> Any:
        """Run what the command line asks for."""
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, SystemExit) as stop:
            _fail(*words(stop))


app = Verbs(
    name="reenact",
    cls=_Program,
    help="Record a robot, replay the recording, learn from it, deploy what was learned, and prove it still works.",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def _reenact(
    ctx: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    if version:
        console.line(f"reenact {importlib.metadata.version('reenact')}")
        raise typer.Exit
    help_without_verb(ctx)


app.command(epilog="Example: reenact demo --out out/demo")(demo_train_evaluate_diff.demo)
app.command(epilog="Example: reenact explore --motion circles --seed 0 --out circles.mcap")(exploring.explore)
app.command(epilog="Example: reenact demonstrate right_hand_house --out house.mcap")(demonstrating.demonstrate)
app.command(
    epilog="Example: reenact robot\n\n"
    "Then, in a second terminal: reenact explore --connect tcp/127.0.0.1:7447 --motion eight"
)(exploring.robot)
app.command(epilog="Example: reenact record --out session.mcap --exclude /tf")(recording.record)
app.command(epilog="Example: reenact train circles.mcap --out controller.npz")(demo_train_evaluate_diff.train)
app.command(
    epilog="Example: reenact learn --out controller.npz\n\n"
    "Then, in a second terminal: reenact replay circles.mcap --epochs 150"
)(learn_replay.learn)
app.command(
    epilog="Example: reenact replay circles.mcap --epochs 150\n\n"
    "Before, in a second terminal: reenact learn --out controller.npz"
)(learn_replay.replay)
app.command(epilog="Example: reenact serve controller.npz --record served.mcap")(serving.serve)
app.command(epilog="Example: reenact status --watch")(status.status)
app.command(epilog="Example: reenact evaluate controller.npz eight --deploy")(demo_train_evaluate_diff.evaluate)
app.command(epilog="Example: reenact diff recorded.mcap replayed.mcap")(demo_train_evaluate_diff.diff)
app.command(epilog="Example: reenact info session.mcap")(info_recover.info)
app.command(epilog="Example: reenact recover session.mcap.part --out recovered.mcap")(info_recover.recover)
app.command(epilog="Example: reenact paper --out out/paper")(paper.paper)
app.command(epilog="Example: reenact view controller.npz --save controller.rrd")(viewing.view)
app.add_typer(golden.app)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line: status 0 done and holds, 1 a check failed, 2 bad usage or bad input."""
    console.take_any_text()
    end_by_exceptions()
    # What click raises on bad usage; typer carries click within itself and exports only this subclass.
    usage_error: Any = typer.BadParameter.__bases__[0]
    try:
        status = app(arguments, prog_name="reenact", standalone_mode=False)
    except ReenactError as error:
        _fail(str(error), error.exit_status)
    except OSError as error:
        _fail(f"{error.filename or 'system'}: {error.strerror or error}", 2)
    except ModuleNotFoundError as error:
        missing = missing_extra(error)
        if missing is None:
            raise
        _fail(str(missing), missing.exit_status)
    except MemoryError:
        _fail("there is not enough memory for this; close other programs, or take a smaller input", 2)
    except usage_error as error:
        _fail(usage_line(error), 2)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(line: str, status: int) -> NoReturn:
    console.say(f"reenact: {printable(line_text(line))}")
    sys.exit(status)
