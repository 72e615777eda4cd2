"""The report of the paper's rerun: its page needs nothing else, its pictures repeat, its numbers are the run's."""

import re
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text
from small_paper import DRAWINGS, SEEDS, small_paper

from pipeline.evaluation.trials import Trial
from pipeline.motions.patterns.circles import circles
from pipeline.paper import figures
from pipeline.paper.bounds import spread
from pipeline.paper.error_analysis import ALIKE, APART, UPRIGHT, depths, directions, turning_point
from pipeline.paper.figures import draw_figures
from pipeline.paper.report import write_report
from pipeline.paper.results import PATTERN_1, PATTERN_2, PaperResults
from pipeline.paper.run import check_bounds
from pipeline.paper.table import console_table, rows
from pipeline.robot.config import load_robot
from pipeline.views.figures import draw_errors
from pipeline.views.robot_drawing import RobotDrawing, View
from recorders.errors import CheckFailed, ConfigError

PICTURES = {
    *(f"figure{number}{part}.png" for number in "45" for part in ("a", "bc", "de")),
    "figure6.png",
    "figure6_postures.png",
}


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> PaperResults:
    return small_paper(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def page(paper: PaperResults, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(paper, tmp_path_factory.mktemp("report"))


class _Page(HTMLParser):
    """Gathers what a page refers to, and checks that what is opened is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture
def parsed(page: Path) -> _Page:
    found = _Page()
    found.feed(page.read_text(encoding="utf-8"))
    return found


def test_the_page_holds_its_pictures_and_refers_to_nothing(page: Path, parsed: _Page) -> None:
    assert parsed.open == []
    assert parsed.tags.count("img") == len(PICTURES)
    assert not {"script", "link", "iframe", "object", "base"} & set(parsed.tags)
    assert all(source.startswith("data:image/png;base64,") for source in parsed.sources)
    within = {b64decode(source.partition(",")[2]) for source in parsed.sources}
    assert within == {(page.parent / name).read_bytes() for name in PICTURES}
    text = re.sub(r"base64,[^\"]*", "", page.read_text(encoding="utf-8"))
    assert not re.search(r"https?:|url\(|@import|\$", text)
    assert "<drawing>" not in text  # names are escaped
    assert "second &lt;drawing&gt; (generated)" in text
    assert str(page.parent) not in text


def test_every_picture_is_beside_the_page(page: Path) -> None:
    assert {path.name for path in page.parent.glob("*.png")} == PICTURES
    for name in PICTURES:
        assert imread(page.parent / name).shape[1] == 1900


def test_equal_results_are_drawn_alike_and_a_short_run_says_so(paper: PaperResults, page: Path, tmp_path: Path) -> None:
    short = write_report(paper, tmp_path, is_full=False).read_text(encoding="utf-8")
    for name in PICTURES:
        assert (tmp_path / name).read_bytes() == (page.parent / name).read_bytes()
    full = page.read_text(encoding="utf-8")
    assert "its numbers mean nothing" in short
    assert "its numbers mean nothing" not in full
    after = "<h2>Figure 4: networks that learned pattern 1</h2>"
    assert short.partition(after)[2] == full.partition(after)[2] != ""


def test_a_table_gives_each_number_with_seeds_and_command(paper: PaperResults) -> None:
    found = list(rows(paper))
    one = paper.networks[PATTERN_1]
    first = found[0]
    assert first.ours == f"{one.curves_cm[:, -1].mean():.2f} ± {np.std(one.curves_cm[:, -1], ddof=1):.2f}"
    assert first.papers == "2.79"
    assert first.linear == "0.50"
    assert first.teacher == f"{paper.networks[PATTERN_1].trials[PATTERN_1][0].teacher.mean_cm:.2f}"
    assert first.seeds == "4–5"
    assert first.commands == (
        "reenact train circles.mcap --epochs 2 --seed SEED --out again-circles-SEED.npz",
        "reenact diff again-circles-SEED.npz controllers/circles-SEED.npz",
        "reenact evaluate controllers/circles-SEED.npz circles.mcap --linear-from circles.mcap",
    )
    assert first.printed == "train_cm"
    farthest = next(row for row in found if row.what == "first drawing (generated), pattern 1 learned: left, farthest")
    assert farthest.ours.startswith(f"{one.errors_cm(DRAWINGS[0], 'left_max_cm').mean():.2f} ±")
    assert farthest.printed == "left_max_cm"
    assert found[-2].commands == ("reenact evaluate controllers/circles-4.npz eight --deploy",)
    assert len(found) == 4 + 2 * 3 * len(DRAWINGS) + 2
    assert console_table(paper).row_count == len(found)


def test_motions_and_errors_are_taken_apart_by_direction(paper: PaperResults) -> None:
    alike, opposed, upright = directions(paper)
    targets = paper.networks[PATTERN_1].trials[PATTERN_1][0].targets.reshape(-1, 2, 3)
    offsets = 100.0 * (targets - targets.mean(axis=0)) @ paper.robot.lateral
    assert alike.pattern_1_cm == pytest.approx(offsets.mean(axis=1).std())
    assert opposed.pattern_1_cm == pytest.approx((0.5 * (offsets[:, 0] - offsets[:, 1])).std())
    assert upright.missed_cm[PATTERN_1] == upright.missed_cm[PATTERN_2] > 0.0


@pytest.mark.parametrize(("part", "followed", "missed_cm"), [(1.0, 1.0, 0.0), (0.0, 0.0, 5.0), (0.5, 0.5, 2.5)])
def test_hands_that_follow_a_part_of_a_direction_are_found_out(
    paper: PaperResults, part: float, followed: float, missed_cm: float
) -> None:
    robot, two = paper.robot, paper.networks[PATTERN_2]
    whole = circles(robot).targets
    aside = 0.5 * ((whole[:, 0] - robot.centres[0]) - (whole[:, 1] - robot.centres[1])) @ robot.lateral  # (T,)
    lost = (1.0 - part) * aside[:, np.newaxis] * robot.lateral
    reached = whole - np.stack([lost, -lost], axis=1)
    trial = replace(two.trials[PATTERN_1][0], targets=whole.reshape(-1, 6), reached=reached)
    one = replace(paper.networks[PATTERN_1], trials={**paper.networks[PATTERN_1].trials, PATTERN_1: (trial,)})
    two = replace(two, trials={**two.trials, PATTERN_1: (trial,)})
    found = {way.name: way for way in directions(replace(paper, networks={PATTERN_1: one, PATTERN_2: two}))}
    assert found[APART].followed[PATTERN_2] == pytest.approx(followed, abs=1e-9)
    assert found[APART].missed_cm[PATTERN_2] == pytest.approx(missed_cm, abs=1e-6)
    for name in (ALIKE, UPRIGHT):
        assert found[name].followed[PATTERN_2] == pytest.approx(1.0)
        assert found[name].missed_cm[PATTERN_2] == pytest.approx(0.0, abs=1e-9)


def test_errors_are_taken_apart_into_plane_and_depth(paper: PaperResults) -> None:
    one = paper.networks[PATTERN_1]
    first = depths(paper, one)[0]
    offsets = np.array([trial.reached[:, 0] - trial.targets[:, :3] for trial in one.trials[PATTERN_1]])  # x is depth
    assert (first.motion, first.hand) == (PATTERN_1, "left")
    assert first.missed_cm == pytest.approx(one.errors_cm(PATTERN_1, "left_cm").mean())
    assert first.out_cm == pytest.approx(10.0)
    assert first.in_plane_cm == pytest.approx(100.0 * np.linalg.norm(offsets[:, :, 1:], axis=2).mean())
    assert first.off_plane_cm == pytest.approx(100.0 * np.abs(offsets[:, :, 0]).mean())


def test_a_drawing_that_leaves_what_was_learned_is_said_to(paper: PaperResults, page: Path, tmp_path: Path) -> None:
    assert "extrapolate" not in page.read_text(encoding="utf-8")  # all motions here are circles
    one, name = paper.networks[PATTERN_1], DRAWINGS[0]
    trials = tuple(_wider(trial, paper) for trial in one.trials[name])
    wide = replace(paper, networks={**paper.networks, PATTERN_1: replace(one, trials={**one.trials, name: trials})})
    text = write_report(wide, tmp_path).read_text(encoding="utf-8")
    part = next(part for part in depths(wide, wide.networks[PATTERN_1]) if (part.motion, part.hand) == (name, "right"))
    assert part.out_cm == pytest.approx(20.0)
    assert (
        f"in first drawing (generated), up to 20.0 cm out, the right hand misses by {part.missed_cm:.2f} cm: "
        f"{part.off_plane_cm:.2f} cm ahead or behind, {part.in_plane_cm:.2f} cm in the plane"
    ) in text
    assert "the left hand misses" not in text


def _wider(trial: Trial, paper: PaperResults) -> Trial:
    """The same trial with targets of the right hand twice as far out."""
    targets = trial.targets.copy()
    targets[:, 3:] += targets[:, 3:] - paper.robot.centres[1]
    return replace(trial, targets=targets)


def test_every_picture_says_how_to_read_it(
    paper: PaperResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts: dict[str, str] = {}

    def keep(figure: Figure, path: Path) -> None:
        texts[path.name] = "\n".join(text.get_text() for text in figure.findobj(Text))
        if path.name != "figure6_postures.png":
            texts[path.name] += "\n".join(axes.get_xlabel() + axes.get_ylabel() for axes in figure.axes)

    monkeypatch.setattr(figures, "save_figure", keep)
    pictures = draw_figures(paper, tmp_path)
    assert texts.keys() == PICTURES
    for picture in pictures:
        assert picture.key in texts[picture.name]
    for name in PICTURES - {"figure4a.png", "figure5a.png", "figure6_postures.png"}:
        assert "Seen from behind" in texts[name]
        assert "left of the robot's middle (cm)" in texts[name]
    assert "Seen from ahead" in texts["figure6_postures.png"]
    assert "20 cm" in texts["figure6_postures.png"]
    assert f"mean of {len(SEEDS)}: " in texts["figure4a.png"]
    assert "First drawing (generated)" in texts["figure4de.png"]


def test_captions_say_it_too(page: Path) -> None:
    captions = re.findall("<figcaption>(.*?)</figcaption>", page.read_text(encoding="utf-8"))
    assert len(captions) == len(PICTURES)
    assert all(re.search("Seen from|one standard deviation", caption) for caption in captions)


@pytest.mark.parametrize("epochs", [1, 2, 3, 7])
def test_epochs_are_whole(epochs: int) -> None:
    axes = Figure().subplots()
    draw_errors(axes, np.linspace(3.0, 2.0, epochs), {"the paper": 2.79})
    low, high = axes.get_xlim()
    ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
    assert ticks
    assert all(tick == round(tick) for tick in ticks)


@pytest.mark.parametrize(("curve", "turn"), [([3.0, 1.0, 2.0], (2, 1.0)), ([3.0, 2.0, 1.0], None)])
def test_an_error_that_grows_again_is_noticed(
    paper: PaperResults, curve: list[float], turn: tuple[int, float] | None
) -> None:
    assert turning_point(replace(paper.networks[PATTERN_1], curves_cm=np.array([curve, curve]))) == turn


def test_the_spread_of_one_network_is_zero() -> None:
    assert spread(np.array([3.0])) == 0.0
    assert spread(np.array([1.0, 3.0])) == pytest.approx(2.0**0.5)


def test_a_report_that_cannot_be_written_is_one_line(paper: PaperResults, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot write the report '.*figure4a\.png'"):
        draw_figures(paper, tmp_path / "none")


def test_bounds_hold_or_are_named(paper: PaperResults) -> None:
    check_bounds(_with_errors(paper, trained_cm=(1.4, 1.5), others_cm=(1.3, 3.75), left_cm=1.99))
    failing = _with_errors(paper, trained_cm=(1.41, 1.5), others_cm=(1.3, 3.74), left_cm=2.0)
    with pytest.raises(CheckFailed) as failure:
        check_bounds(failing)
    text = str(failure.value)
    assert "pattern 1, by networks that learned it: at most 1.40 cm, found 1.41 cm" in text
    assert "at least 2.5 times worse on pattern 1, found 2.49 times" in text
    assert text.count("left hand, held still") == len(DRAWINGS)
    assert "1.30" not in text
    assert "pattern 2, by networks that learned it" not in text


def _with_errors(
    paper: PaperResults, *, trained_cm: tuple[float, float], others_cm: tuple[float, float], left_cm: float
) -> PaperResults:
    """The same run with other errors."""
    networks = {}
    others = (PATTERN_2, PATTERN_1)
    for one, trained, other, cm in zip(paper.networks.values(), trained_cm, others, others_cm, strict=True):
        trials = {
            name: tuple(_missing_by(trial, cm if name == other else 1.0, left_cm) for trial in tried)
            for name, tried in one.trials.items()
        }
        networks[one.pattern] = replace(one, curves_cm=np.full((len(SEEDS), 1), trained), trials=trials)
    return replace(paper, networks=networks)


def _missing_by(trial: Trial, mean_cm: float, left_cm: float) -> Trial:
    return replace(
        trial, errors=replace(trial.errors, mean_cm=mean_cm, hands_cm=trial.errors.hands_cm | {"left": left_cm})
    )


def test_a_robot_is_drawn_from_any_side() -> None:
    robot = load_robot("asimo")
    drawing = RobotDrawing(robot)
    axes = Figure().subplots()
    for azimuth_deg in (-90.0, 0.0, 180.0):
        drawing.draw(axes, robot.comfort, view=View(azimuth_deg=azimuth_deg))
    outlines = [np.concatenate([path.vertices for path in drawn.get_paths()]) for drawn in axes.collections]
    heights = [outline[:, 1].max() - outline[:, 1].min() for outline in outlines]
    assert all(115.0 < height < 135.0 for height in heights)  # cm; the head's top is at 1.16 to 1.23 m


def test_a_view_is_a_rotation_and_looks_from_where_it_says() -> None:
    robot = load_robot("asimo")
    for view in (View(), View(azimuth_deg=120.0, elevation_deg=-30.0)):
        axes = view.axes(robot)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
    ahead = View(azimuth_deg=0.0, elevation_deg=0.0).axes(robot)
    np.testing.assert_allclose(ahead, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], atol=1e-12)
