"""The command line, `reenact`: one verb a function, each a thin layer over the module that does the work."""

import signal
import sys
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer

from pipeline import console
from recorders.errors import ReenactError

app = typer.Typer(
    name="reenact",
    help="Record a robot, replay the recording, learn from it, deploy what was learned, and prove it still works.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")]
Seed = Annotated[int, typer.Option(help="Seed of every random draw.", min=0)]
Epochs = Annotated[int, typer.Option(help="Epochs of training: 150 for circles, 600 for eight.", min=1)]
Logs = Annotated[list[Path], typer.Argument(help="Logs, presented in this order.", metavar="LOG.mcap...")]
Listen = Annotated[list[str] | None, typer.Option(help="Endpoint to listen on, such as tcp/127.0.0.1:7447.")]
Connect = Annotated[list[str] | None, typer.Option(help="Endpoint to connect to, such as tcp/127.0.0.1:7447.")]
Namespace = Annotated[str, typer.Option(help="First part of every Zenoh key.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the file if it exists.")]


@app.command(epilog="Example: reenact demo --out out/demo")
def demo(
    out: Annotated[Path, typer.Option(help="Folder for logs, controller, report and summary.")] = Path("out/demo"),
    seed: Seed = 0,
    epochs: Epochs = 150,
    as_json: Json = False,
) -> None:
    """Explore, record, replay over Zenoh, learn, check and report: the main job, end to end."""
    from pipeline.demo import results_table, run_demo

    result = run_demo(out, seed=seed, epochs=epochs)
    if as_json:
        console.show(result.summary(out), as_json=True)
        return
    console.table(results_table(result))
    digest, took = result.file_digest[:16], sum(result.seconds.values())
    print(f"State digest {digest}…, over Zenoh and from the file alike. {took:.0f} s. Look at {out / 'report.png'}")


@app.command(epilog="Example: reenact explore --motion circles --robot asimo --seed 0 --out circles.mcap")
def explore(
    motion: Annotated[str, typer.Option(help="circles, eight, or a CSV file with t,lx,ly,lz,rx,ry,rz [s, m].")],
    out: Annotated[Path, typer.Option(help="Log to write.")],
    robot: Annotated[str, typer.Option(help="Robot that comes with the program, or a folder of one.")] = "asimo",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Let the teacher and the simulated robot follow a motion, and write the episode to a log."""
    from pipeline.exploration import explore as run
    from pipeline.motions import load_motion
    from pipeline.robot import load_robot

    config = load_robot(robot)
    with console.progress(f"explore {Path(motion).stem}") as advance:
        summary = run(config, load_motion(motion, config), seed=seed, out=out, overwrite=overwrite, progress=advance)
    console.show(asdict(summary) | {"path": str(summary.path)}, as_json=as_json)


@app.command(epilog="Example: reenact train circles.mcap --out controller.npz")
def train(
    logs: Logs,
    out: Annotated[Path, typer.Option(help="Controller to write.")],
    seed: Seed = 0,
    epochs: Epochs = 150,
    as_json: Json = False,
) -> None:
    """Train the learner straight from logs; the digest is that of the same logs replayed over Zenoh."""
    from pipeline.learner_config import LearnerConfig
    from pipeline.training import train as run
    from replay.schedule import Schedule

    schedule = Schedule(epochs=epochs)
    with console.progress("train") as advance:
        trainer = run(
            logs,
            schedule=schedule,
            config=LearnerConfig(seed=seed),
            on_cycle=lambda cycle: advance((cycle.epoch + 1) / epochs),
        )
    trainer.controller().save(out)
    console.show(trainer.result() | {"controller": str(out)}, as_json=as_json)


@app.command(epilog="Example, in a second terminal: reenact replay circles.mcap --epochs 150")
def learn(
    out: Annotated[Path, typer.Option(help="Controller to write when the stream ends.")],
    name: Annotated[str, typer.Option(help="Name by which a replay awaits this learner.")] = "learner",
    robot: Annotated[str | None, typer.Option(help="Robot; by default the one that the stream names.")] = None,
    seed: Seed = 0,
    listen: Listen = None,
    connect: Connect = None,
    namespace: Namespace = "reenact",
    as_json: Json = False,
) -> None:
    """Learn online from a stream over Zenoh, until it ends."""
    from pipeline.learner_config import LearnerConfig
    from pipeline.nodes import learn as run
    from pipeline.robot import load_robot
    from pipeline.training import Trainer
    from recorders.wire.receiver import ReceiverConfig
    from recorders.wire.session import DEFAULT_ENDPOINT, SessionConfig

    session = SessionConfig(
        connect=tuple(connect or ()), listen=tuple(listen or ([] if connect else [DEFAULT_ENDPOINT]))
    )
    config = None if robot is None else load_robot(robot)
    with console.progress("learn") as advance:
        trainer = Trainer(
            LearnerConfig(seed=seed),
            robot=config,
            on_cycle=lambda cycle: advance((cycle.epoch + 1) / trainer.epochs),
        )
        receiver = ReceiverConfig(name=name, namespace=namespace)
        result = run(trainer, session=session, receiver=receiver, say=console.say)
    trainer.controller().save(out)
    console.show(result | {"controller": str(out)}, as_json=as_json)


@app.command(epilog="Example, in a second terminal: reenact learn --out controller.npz")
def replay(
    logs: Logs,
    awaited: Annotated[
        list[str] | None, typer.Option("--await", help="Name of a consumer to feed and wait for; learner if left out.")
    ] = None,
    epochs: Epochs = 150,
    window: Annotated[int, typer.Option(help="Messages under way unacknowledged.", min=1)] = 1024,
    batch: Annotated[int, typer.Option(help="Messages in one payload.", min=1)] = 64,
    wait: Annotated[float, typer.Option(help="Seconds to wait for the consumers to appear.", min=0)] = 10.0,
    listen: Listen = None,
    connect: Connect = None,
    namespace: Namespace = "reenact",
    as_json: Json = False,
) -> None:
    """Replay logs over Zenoh into an online learner, as fast as it acknowledges."""
    from pipeline.nodes import replay as run
    from recorders.wire.session import DEFAULT_ENDPOINT, SessionConfig
    from replay.schedule import Schedule
    from replay.zenoh_transport import SenderConfig

    session = SessionConfig(
        connect=tuple(connect or ([] if listen else [DEFAULT_ENDPOINT])), listen=tuple(listen or ())
    )
    sender = SenderConfig(
        consumers=tuple(awaited or ("learner",)),
        namespace=namespace,
        window=window,
        batch=min(batch, window),
        wait_s=wait,
    )
    with console.progress("replay") as advance:
        result = run(logs, schedule=Schedule(epochs=epochs), session=session, sender=sender, on_progress=advance)
    console.show(result if as_json else _flat(result), as_json=as_json)


@app.command(epilog="Example: reenact evaluate controller.npz eight --json")
def evaluate(
    controller: Annotated[Path, typer.Argument(help="Controller to try.", metavar="CONTROLLER.npz")],
    motion: Annotated[str, typer.Argument(help="A log, a CSV file, circles or eight.", metavar="MOTION.csv|LOG.mcap")],
    as_json: Json = False,
) -> None:
    """Try a controller on a motion or a recording: distances of both hands from their targets."""
    from pipeline.controller import Controller
    from pipeline.trials import try_motion

    trial = try_motion(Controller.load(controller), motion)
    result: dict[str, Any] = asdict(trial.errors)
    for name, errors in (("teacher_cm", trial.teacher), ("linear_cm", trial.linear)):
        if errors is not None:
            result[name] = errors.mean_cm
    console.show(result, as_json=as_json)


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
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        _fail(f"{error.filename or 'system'}: {error.strerror or error}", 2)
    except usage_error as error:
        _fail(f"{error.format_message()} (reenact --help shows what there is)", 2)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(line: str, status: int) -> None:
    console.say(f"reenact: {' '.join(line.split())}")
    sys.exit(status)


def _flat(result: dict[str, Any]) -> dict[str, Any]:
    """Name the entries of each consumer's result after it."""
    flat = {name: value for name, value in result.items() if name != "consumers"}
    for consumer, entries in result["consumers"].items():
        flat |= {f"{consumer}: {name}": value for name, value in entries.items()}
    return flat


def _terminate(signum: int, frame: FrameType | None) -> None:
    """Turn SIGTERM into an exception, so that every open file and session is finished on the way out."""
    sys.exit(128 + signum)
