"""A recording in parts is one session for every verb: the same results, to the digest, as from one log."""

import json
from pathlib import Path

import pytest
from episodes import write_episode
from sessions import split

from pipeline.cli import app
from recorders.containers.opening import open_log
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter
from replay.sources.playback import Playback
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.sources.session import RecordedSession

WAYS = ("list", "folder", "stem")


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An episode and a recorded session, each in one log and in parts: a cut in the middle of a tick, and another."""
    folder = tmp_path_factory.mktemp("parts")
    episode = write_episode(folder / "episode.mcap", samples=16)
    replay = Replay([episode], Schedule(epochs=1))
    attachments = {"robot.toml": replay.robot["toml"].encode(), "robot.urdf": replay.robot["urdf"].encode()}
    manifest = {"kind": "recording", "schedule": replay.schedule.to_dict()}
    with LogWriter(folder / "session.mcap", manifest=manifest, attachments=attachments) as writer:
        for time_ns, record in enumerate(replay.stream()):
            writer.copy(record._replace(log_time_ns=time_ns))
    for name, at in (("episode", (10, 11, 30)), ("session", (1, 20, 200))):
        (folder / name).mkdir()
        split(folder / f"{name}.mcap", folder / name / f"{name}.mcap", at)
    (folder / "learner.toml").write_text("reservoir = 30\nseed = 4\n")
    return folder


def named(work: Path, name: str, way: str) -> list[str]:
    """Return the parts as a user may name them; a list comes in any order."""
    folder = work / name
    if way == "list":
        return sorted(map(str, folder.iterdir()), reverse=True)
    return [str(folder if way == "folder" else folder / f"{name}.mcap")]


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[dict[str, object], str]:
    with pytest.raises(SystemExit) as end:
        app.main([*map(str, arguments), "--json"])
    printed = capsys.readouterr()
    assert end.value.code == 0, printed.err
    return json.loads(printed.out), printed.err


@pytest.mark.parametrize("option", ["--as-recorded", "--as-live"])
def test_a_session_trains_to_the_digest_of_the_whole(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    out = ("--out", tmp_path / "out.npz")
    whole, _ = run(capsys, "train", work / "session.mcap", option, *out)
    for way in WAYS:
        (tmp_path / "out.npz").unlink()
        assert run(capsys, "train", *named(work, "session", way), option, *out) == (whole, "")


def test_an_episode_in_parts_is_one_episode(work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def trained(number: int, *logs: object) -> object:
        result, said = run(capsys, "train", *logs, "--epochs", 1, "--out", tmp_path / f"{number}.npz")
        assert said == ""
        return result["digest"]

    whole = trained(0, work / "episode.mcap")
    assert {trained(1 + place, *named(work, "episode", way)) for place, way in enumerate(WAYS)} == {whole}
    beside = trained(4, work / "episode.mcap", *named(work, "episode", "list"), work / "episode.mcap")
    assert beside == trained(5, *[work / "episode.mcap"] * 3)
    evaluated = [
        run(capsys, "evaluate", tmp_path / "0.npz", motion, "--linear-from", linear)
        for motion, linear in ((work / "episode.mcap", work / "episode.mcap"), (work / "episode", work / "episode"))
    ]
    assert evaluated[0] == evaluated[1]


def test_an_episode_in_parts_is_left_aside_as_one(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_episode(tmp_path / "other.mcap", samples=9)

    def trained(*held_out: object) -> tuple[object, object]:
        aside = [text for log in held_out for text in ("--hold-out", log)]
        out = ("--epochs", 1, "--overwrite", "--out", tmp_path / "out.npz")
        result, _ = run(capsys, "train", other, *aside, *out)
        return result["digest"], result["held_out"]

    assert trained(*named(work, "episode", "list")) == trained(work / "episode.mcap")


def test_a_replay_and_a_playback_are_those_of_the_whole(work: Path) -> None:
    whole, parts = work / "session.mcap", work / "session"
    assert list(Playback([parts]).stream()) == list(Playback([whole]).stream())
    assert Playback([parts]).offer().run == Playback([whole]).offer().run
    assert list(RecordedSession(parts).stream()) == list(RecordedSession(whole).stream())
    assert Replay([work / "episode"], Schedule()).run == Replay([work / "episode.mcap"], Schedule()).run


@pytest.mark.parametrize("way", WAYS)
def test_a_golden_case_of_parts_is_that_of_the_whole(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], way: str
) -> None:
    settings = ("--config", work / "learner.toml", "--cases", tmp_path)
    for logs, name in (([work / "session.mcap"], "whole"), (named(work, "session", way), "parts")):
        run(capsys, "golden", "add", *logs, "--as-recorded", "--name", name, *settings)
    parts, whole = (json.loads((tmp_path / name / "case.json").read_text()) for name in ("parts", "whole"))
    assert parts["expected"] == whole["expected"]
    assert list(open_log(tmp_path / "parts" / "session.mcap")) == list(open_log(work / "session.mcap"))


@pytest.mark.parametrize("way", ["folder", "stem"])
def test_it_does_not_differ_from_the_whole(work: Path, capsys: pytest.CaptureFixture[str], way: str) -> None:
    result, _ = run(capsys, "diff", work / "session.mcap", *named(work, "session", way))
    assert result == {"equal": True, "first_divergence": None}


@pytest.mark.parametrize("way", WAYS)
def test_it_is_shown_as_one(work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], way: str) -> None:
    whole, _ = run(capsys, "view", work / "episode.mcap", "--save", tmp_path / "whole.rrd")
    parts, _ = run(capsys, "view", *named(work, "episode", way), "--save", tmp_path / "parts.rrd")
    assert parts["samples"] == whole["samples"] == 17


def test_a_part_that_is_missing_is_one_line_for_every_verb(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = split(work / "session.mcap", tmp_path / "cut.mcap", (1, 20, 200))
    parts[1].unlink()
    out = ("--out", tmp_path / "out.npz")
    for arguments in (
        ("train", tmp_path, "--as-recorded", *out),
        ("train", *parts[2:], parts[0], "--as-live", *out),
        ("train", tmp_path / "cut.mcap", *out),
        ("replay", tmp_path, "--play"),
        ("replay", *parts[2:], parts[0]),
        ("diff", tmp_path, work / "session.mcap"),
        ("view", tmp_path, "--save", tmp_path / "a.rrd"),
        ("demonstrate", tmp_path, *out),
    ):
        with pytest.raises(SystemExit) as end:
            app.main(list(map(str, arguments)))
        said = capsys.readouterr().err
        assert (end.value.code, said.count("\n")) == (2, 1), said
        assert "cut.mcap: part 1 is missing: expected parts 0 to 3, found 0, 2, 3" in said


@pytest.mark.parametrize("name", ["log", "log.MCAP", "log.mcap.part"])
def test_a_log_of_any_name_is_one_for_every_verb(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    log, learned = tmp_path / name, tmp_path / "learned"
    log.write_bytes((work / "episode.mcap").read_bytes())
    run(capsys, "train", log, "--epochs", 1, "--out", tmp_path / "out.npz")
    (tmp_path / "out.npz").rename(learned)
    evaluated, _ = run(capsys, "evaluate", learned, log, "--linear-from", log)
    assert evaluated == run(capsys, "evaluate", learned, work / "episode.mcap")[0]
    for pair in ((log, work / "episode.mcap"), (learned, learned)):
        assert run(capsys, "diff", *pair)[0] == {"equal": True, "first_divergence": None}
    assert run(capsys, "view", log, "--save", tmp_path / "log.rrd")[0]["samples"] == 17
    shown = ("demonstrate", log, "--align", "as-is", "--on-unreachable", "keep", "--out", tmp_path / "shown.mcap")
    run(capsys, *shown)
    assert LogReader(tmp_path / "shown.mcap").counts


@pytest.mark.parametrize("way", WAYS)
def test_what_is_said_of_it_is_said_of_the_whole(work: Path, capsys: pytest.CaptureFixture[str], way: str) -> None:
    whole, _ = run(capsys, "info", work / "session.mcap")
    found, _ = run(capsys, "info", *named(work, "session", way))
    assert found.pop("parts") == [str(path) for path in sorted((work / "session").iterdir())]
    for name in ("sound", "finished", "complete", "messages", "first_ns", "last_ns", "topics", "sessions"):
        assert found[name] == whole[name]
    assert found["path"] == str(work / "session" / "session.mcap")


def test_damage_to_a_part_is_said_with_its_name(work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parts = split(work / "session.mcap", tmp_path / "cut.mcap", (50, 100))
    parts[1].write_bytes(parts[1].read_bytes()[:-300])
    with pytest.raises(SystemExit) as end:
        app.main(["info", str(tmp_path), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (end.value.code, found["sound"], found["finished"]) == (1, False, False)
    assert [damage["reason"].partition(":")[0] for damage in found["damage"]] == ["cut_001.mcap"]


def test_a_part_that_is_named_alone_is_said_to_be_one(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = work / "episode" / "episode_003.mcap"
    out = ("--out", tmp_path / "out.npz")
    line = f"{part} is one part of a session, taken alone; episode.mcap beside it names them all\n"
    for arguments in (
        ("train", part, "--as-live", *out),
        ("evaluate", tmp_path / "out.npz", part),
        ("view", part, "--save", tmp_path / "part.rrd"),
        ("info", part),
        ("demonstrate", part, "--align", "as-is", "--on-unreachable", "keep", "--out", tmp_path / "shown.mcap"),
    ):
        assert line in run(capsys, *arguments)[1]
