"""Command line `reenact`: its verbs, and errors as one line and an exit status."""

import sys
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from pipeline.cli.interrupts import exit_line
from pipeline.cli.learning import demo, evaluate, golden, paper, train
from pipeline.cli.logs import cat, convert, diff, export, info, recover, view
from pipeline.cli.network import learn, record, replay, serve, status
from pipeline.cli.project_settings import project_defaults
from pipeline.cli.robot import demonstrate, explore, play, robot
from pipeline.cli.ros_domain import with_domain
from pipeline.cli.usage import Verbs, help_without_verb, usage_line
from pipeline.extras import missing_extra
from pipeline.terminal import console
from pipeline.terminal.log_lines import logging_to_terminal
from pipeline.terminal.signals import end_by_exceptions
from recorders.errors import DISTRIBUTION, ReenactError
from recorders.text.wording import escape_control, line_text

_ARGUMENTS = "reenact.arguments"  # in click's own store


class _Program(TyperGroup):
    """Group of the verbs that ends with a line where a signal cut one short: click prints none after Ctrl-C."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options before the verb, and keep the whole command line for `invoke`."""
        args = with_domain(args)
        ctx.meta[_ARGUMENTS] = list(args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the verb with the project's settings, and print what is logged meanwhile."""
        try:
            with logging_to_terminal():
                ctx.default_map = project_defaults(self, ctx.meta[_ARGUMENTS])
                return super().invoke(ctx)
        except (KeyboardInterrupt, SystemExit) as stop:
            _fail(*exit_line(stop))


app = Verbs(
    name="reenact",
    cls=_Program,
    help="Record a robot, replay the recording, learn from it, deploy what was learned, and prove it still works.",
    epilog="Example: reenact demo --out out/demo\n\nMore of a verb, such as train: reenact train --help",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def _reenact(
    ctx: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    if version:
        import importlib.metadata

        console.line(f"reenact {importlib.metadata.version(DISTRIBUTION)}")
        raise typer.Exit
    help_without_verb(ctx)


app.command(epilog="Example: reenact demo --out out/demo")(demo.demo)
app.command(epilog="Example: reenact explore --motion circles --seed 0 --out circles.mcap")(explore.explore)
app.command(epilog="Example: reenact demonstrate right_hand_house --out house.mcap")(demonstrate.demonstrate)
app.command(epilog="Example: reenact record --out session.mcap --exclude /tf")(record.record)
app.command(epilog="Example: reenact train circles.mcap --out controller.npz")(train.train)
app.command(
    epilog="Example: reenact learn --out controller.npz\n\n"
    "Then, in a second terminal: reenact replay circles.mcap --epochs 150"
)(learn.learn)
app.command(
    epilog="Example: reenact replay circles.mcap --epochs 150\n\n"
    "Before, in a second terminal: reenact learn --out controller.npz"
)(replay.replay)
app.command(epilog="Example: reenact serve controller.npz --record served.mcap")(serve.serve)
app.command(epilog="Example: reenact status --watch")(status.status)
app.command(epilog="Example: reenact evaluate controller.npz eight --deploy")(evaluate.evaluate)
app.command(epilog="Example: reenact diff recorded.mcap replayed.mcap")(diff.diff)
app.command(epilog="Example: reenact info session.mcap")(info.info)
app.command(epilog="Example: reenact cat session.mcap --topic '/hand/*' -n 10")(cat.cat)
app.command(epilog="Example: reenact convert my_bag/ --out my_bag.mcap")(convert.convert)
app.command(epilog="Example: reenact export session.mcap --out tables --format parquet")(export.export)
app.command(epilog="Example: reenact recover session.mcap.part --out recovered.mcap")(recover.recover)
app.command(epilog="Example: reenact paper --out out/paper")(paper.paper)
app.command(epilog="Example: reenact view controller.npz --save controller.rrd")(view.view)
app.command(epilog="Example: reenact play controller.npz\n\nWithout one, the teacher leads: reenact play")(play.play)
app.add_typer(robot.app)
app.add_typer(golden.app)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line: status 0 done and holds, 1 a check failed, 2 bad usage or bad input."""
    console.take_any_text()
    end_by_exceptions()
    # What click raises on bad usage; typer carries click within itself and exports only this subclass.
    usage_error: Any = typer.BadParameter.__bases__[0]
    try:
        code = app(arguments, prog_name="reenact", standalone_mode=False)
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
    sys.exit(code if isinstance(code, int) else 0)


def _fail(line: str, status: int) -> NoReturn:
    console.notice(f"reenact: {escape_control(line_text(line))}")
    sys.exit(status)
