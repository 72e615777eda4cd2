"""The main job, run as a user runs it: from the checkout, and from a built wheel in a clean environment elsewhere."""

import json
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.image
import pytest
from episodes import write_episode
from processes import reenact

import pipeline
from pipeline.cli import app
from pipeline.demo import deployables
from pipeline.demo import run as demo
from pipeline.demo.trials import DRAWING
from pipeline.evaluation.trials import evaluate_motion
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.drawings import write_motion_csv
from pipeline.motions.motion import Motion, load_motion
from pipeline.published import published_digests
from pipeline.robot.config import load_robot
from pipeline.training.trainer import train
from recorders.reading.reader import LogReader
from replay.sources.schedule import Schedule

pytestmark = pytest.mark.timeout(900)  # whichever test is first has the demo run

ROOT = Path(pipeline.__file__).parent.parent
KEYS = {
    "train_cm",
    "other_cm",
    "demonstration_left_cm",
    "demonstration_right_cm",
    "teacher_cm",
    "linear_cm",
    "file_digest",
    "zenoh_digest",
    "digests",
    "as_published",
    "seconds",
    "controller",
    "logs",
    *(
        f"{controller}{entry}"
        for controller in ("deployable", "self_taught")
        for entry in ("", "_log", "_cm", "_live_digest", "_file_digest")
    ),
}
LEARNING = KEYS - {"seconds"}


@pytest.fixture(scope="module")
def checkout_demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checkout")
    run = reenact("demo", "--out", "out/demo", cwd=folder, timeout_s=600)
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""  # no terminal, no progress
    assert all(
        part in run.stdout for part in ("circles", "eight", "drawing", "2.79", "2.95", "taught", "without teacher")
    )
    assert "As published: yes." in run.stdout, run.stdout
    return folder / "out" / "demo"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a copy of the checkout, with the locked backend and nothing fetched."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    ignored = shutil.ignore_patterns(".venv*", "out", ".git", "__pycache__", ".*_cache", ".hypothesis")
    shutil.copytree(ROOT, source, ignore=ignored)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", str(source)]
    subprocess.run([*command, "--wheel-dir", str(folder)], check=True, capture_output=True, text=True)
    (built,) = folder.glob("reenact_robot-*.whl")
    return built


@pytest.fixture(scope="module")
def elsewhere(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel in an environment where nothing of the checkout is on the path; returns its folder.

    The third-party packages are those of this environment: a `.pth` file adds their folder, and with it Pinocchio's own
    `.pth` file. No other is followed there, so that the checkout's editable install stays out.
    """
    folder = tmp_path_factory.mktemp("elsewhere")
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    target = Path(sysconfig.get_path("purelib", vars={"base": str(folder / "venv")}))
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-deps", str(wheel)]
    subprocess.run(install, check=True, capture_output=True, text=True)
    (target / "locked.pth").write_text(f"{sysconfig.get_path('purelib')}\nimport cmeel_pth\n")
    found = subprocess.run(
        [str(python), "-c", "import pipeline; print(pipeline.__file__)"],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
    )
    assert Path(found.stdout.strip()).is_relative_to(folder)
    return folder


def hand_over_kernels(there: Path) -> None:
    """Put what this checkout has compiled of its kernels beside those of the wheel, whose text is the same."""
    for here in (ROOT / "pipeline").rglob("kernels.py"):
        (copied,) = (there / "venv").rglob(str(here.relative_to(ROOT)))
        assert copied.read_bytes() == here.read_bytes()
        shutil.copystat(here, copied)  # what is compiled is of a file's time and size
        cache = copied.parent / "__pycache__"
        cache.mkdir(exist_ok=True)
        for compiled in (here.parent / "__pycache__").glob("kernels.*.nb[ic]"):
            shutil.copy(compiled, cache)


def demo_elsewhere(folder: Path, *options: str) -> Path:
    """Run the demo of the wheel, and return its results."""
    out = folder / "_".join(("demo", *options))
    command = [str(folder / "venv" / "bin" / "reenact"), "demo", "--out", out.name, *options, "--json"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == summary(out)
    return out


def assert_same(here: Path, there: Path) -> None:
    """Assert that two demos have the same digests, results, logs, pictures and controllers."""
    found, expected = summary(there), summary(here)
    assert {key: found[key] for key in LEARNING} == {key: expected[key] for key in LEARNING}
    logs, controllers = deployables.LOGS, deployables.CONTROLLERS
    for name in (*expected["logs"], *logs, "report.png", "controller.npz", *controllers):
        assert (here / name).read_bytes() == (there / name).read_bytes(), name


def summary(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "summary.json").read_text()))


def test_the_summary_has_the_agreed_keys(checkout_demo: Path) -> None:
    result = summary(checkout_demo)
    assert result.keys() == KEYS
    assert result["as_published"] is True
    assert result["digests"] == published_digests(seed=0, epochs=150, duration_s=120.0)
    assert result["digests"]["controller.npz"] == result["file_digest"]
    assert all(isinstance(value, float) for value in result["seconds"].values())


def test_the_learned_controller_is_as_good_as_promised(checkout_demo: Path) -> None:
    result = summary(checkout_demo)
    assert result["train_cm"] <= 1.6
    assert result["other_cm"] <= 1.6
    assert result["demonstration_left_cm"] < 2.0  # the paper: the hand held still deviates less than 2 cm


def test_over_zenoh_and_from_the_file_are_one_state(checkout_demo: Path) -> None:
    result = summary(checkout_demo)
    assert result["zenoh_digest"] == result["file_digest"]
    assert Controller.load(checkout_demo / result["controller"]).digest == result["file_digest"]


@pytest.mark.parametrize("name", ["deployable", "self_taught"])
def test_a_controller_to_deploy_reaches_half_a_millimetre_on_motions_never_trained(
    checkout_demo: Path, name: str
) -> None:
    found = summary(checkout_demo)[f"{name}_cm"]
    assert found.keys() == {"circles", "eight", "drawing_left", "drawing_right"}
    assert max(found["circles"], found["eight"]) <= 0.04
    assert max(found["drawing_left"], found["drawing_right"]) <= 0.05


@pytest.mark.parametrize("name", ["deployable", "self_taught"])
def test_the_errors_of_a_controller_to_deploy_are_those_of_the_one_that_is_left(
    checkout_demo: Path, tmp_path: Path, name: str
) -> None:
    result = summary(checkout_demo)
    controller = Controller.load(checkout_demo / result[name])
    assert controller.config.rule == "forward-inverse"
    drawing = evaluate_motion(controller, DRAWING).errors
    assert result[f"{name}_cm"] == {
        "circles": evaluate_motion(controller, "circles").errors.mean_cm,
        "eight": evaluate_motion(controller, "eight").errors.mean_cm,
        "drawing_left": drawing.hands_cm["left"],
        "drawing_right": drawing.hands_cm["right"],
    }
    mirrored = evaluate_motion(controller, mirrored_drawing(tmp_path / "left_hand_drawing.csv")).errors
    assert mirrored.mean_cm <= 0.05


def mirrored_drawing(path: Path) -> Path:
    """Write the drawing as the left hand's, mirrored about the robot's middle plane; the right hand is held."""
    robot = load_robot(demo.ROBOT)
    drawn = load_motion(DRAWING, robot)
    targets = drawn.targets[:, ::-1] * [1.0, -1.0, 1.0]
    assert (targets[:, 1] == robot.centres[1]).all()
    write_motion_csv(
        Motion("left_hand_drawing", drawn.times_s, targets, closed=False), path, robot.hand_names, comment="mirrored"
    )
    return path


@pytest.mark.parametrize("name", ["deployable", "self_taught"])
def test_a_controller_to_deploy_learned_live_and_from_its_log_is_one_state(checkout_demo: Path, name: str) -> None:
    result = summary(checkout_demo)
    assert result[f"{name}_live_digest"] == result[f"{name}_file_digest"]
    assert Controller.load(checkout_demo / result[name]).digest == result[f"{name}_file_digest"]


def test_everything_is_left_to_look_at(checkout_demo: Path) -> None:
    result = summary(checkout_demo)
    assert [LogReader(checkout_demo / log).counts["/sample/joint_states"] for log in result["logs"]] == [257, 65]
    page = matplotlib.image.imread(checkout_demo / "report.png")
    assert page.shape[1] == 1900
    assert page.std() > 0.05  # drawn on
    assert (checkout_demo / "robot.rrd").stat().st_size > 100_000
    assert not list(checkout_demo.glob("*.part"))


def train_for(epochs: int, *, seed_offset: int = 0) -> Callable[..., str]:
    """Return what learns from the file in place of the learner over Zenoh."""

    def learned(log: Path, controller: Path, *, seed: int, **options: object) -> str:
        trainer = train([log], schedule=Schedule(epochs=epochs), config=LearnerConfig(seed=seed + seed_offset))
        trainer.controller().save(controller)
        return str(trainer.result()["digest"])

    return learned


def test_a_wheel_installed_elsewhere_gives_the_same_digests_and_results(
    checkout_demo: Path, elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Few epochs, and here those of the logs that there are: what is explored and learned there is all new.

    The kernels are compiled anew in the campaign.
    """
    hand_over_kernels(elsewhere)

    def explored(robot: object, logs: list[Path], **options: object) -> None:
        for log in logs:
            shutil.copy(checkout_demo / log.name, log)

    monkeypatch.setattr(demo, "_explore_both", explored)
    monkeypatch.setattr(demo, "learn_over_zenoh", train_for(8))
    demo.run_demo(tmp_path, seed=0, epochs=8, duration_s=8.0)
    assert_same(tmp_path, demo_elsewhere(elsewhere, "--epochs", "8", "--duration", "8"))


@pytest.mark.campaign
def test_a_wheel_installed_elsewhere_gives_the_same_digests_and_results_in_full(
    checkout_demo: Path, elsewhere: Path
) -> None:
    for compiled in elsewhere.rglob("kernels.*.nb[ic]"):
        compiled.unlink()
    assert_same(checkout_demo, demo_elsewhere(elsewhere))


@pytest.mark.parametrize(
    ("other_seed", "other_state", "complaint"),
    [
        (1, "", "expected one state, found "),
        (0, "0123456789abcdef", "self_taught.npz: expected one state, found 0123456789abcdef learned live and "),
    ],
)
def test_a_learner_that_parts_from_the_file_is_a_failed_check_and_leaves_everything(
    checkout_demo: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    other_seed: int,
    other_state: str,
    complaint: str,
) -> None:
    """Small logs in place of the exploration, and another seed or state in place of a learner's that learned live."""

    def explored(robot: object, logs: list[Path], **options: object) -> None:
        for log in logs:
            write_episode(log, samples=8)

    @contextmanager
    def explored_before(out: Path, **options: object) -> Iterator[tuple[Callable[[], object], Callable[[], str]]]:
        for log in deployables.LOGS:
            shutil.copy(checkout_demo / log, out)
        yield lambda: None, lambda: other_state or str(summary(checkout_demo)["self_taught_live_digest"])

    monkeypatch.setattr(demo, "_explore_both", explored)
    monkeypatch.setattr(deployables, "explorations", explored_before)
    monkeypatch.setattr(demo, "learn_over_zenoh", train_for(1, seed_offset=other_seed))
    with pytest.raises(SystemExit) as end:
        app.main(["demo", "--out", str(tmp_path), "--epochs", "1"])
    assert end.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"reenact: {complaint}")
    found = summary(tmp_path)
    assert (found["zenoh_digest"] != found["file_digest"]) == bool(other_seed)
    assert (found["self_taught_live_digest"] != found["self_taught_file_digest"]) == bool(other_state)
    assert (tmp_path / "report.png").exists()
