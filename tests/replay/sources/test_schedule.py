"""A schedule is the paper's by default, and refuses what is not one."""

import pytest

from recorders.errors import ConfigError
from recorders.messages.topics import reached_tick
from replay.sources.schedule import MAX_CYCLES, Schedule


def test_an_epoch_is_the_papers() -> None:
    phases = [phase for _, phase in Schedule().cycles_of_epoch()]
    assert phases == ["washout", "learn", "learn", "learn", "learn", "learn", "evaluate"]
    assert [cycle for cycle, _ in Schedule().cycles_of_epoch()] == list(range(7))
    assert Schedule().epochs == 150


def test_it_survives_json() -> None:
    schedule = Schedule(epochs=3, phases=(("learn", 2), ("evaluate", 1)))
    assert Schedule.from_dict(schedule.to_dict()) == schedule
    assert schedule.cycles == 3


def test_topics_are_stated_where_they_are_not_those_of_commands() -> None:
    assert "topics" not in Schedule().to_dict()
    reached = Schedule(epochs=1, topics=reached_tick(("left", "right")))
    assert reached.to_dict()["topics"] == list(reached_tick(("left", "right")))
    assert Schedule.from_dict(reached.to_dict()) == reached


def test_the_most_that_may_be() -> None:
    assert Schedule(epochs=MAX_CYCLES, phases=(("learn", MAX_CYCLES),)).cycles == 1_000_000


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"epochs": 0, "phases": [["learn", 1]]},
        {"epochs": 1.5, "phases": [["learn", 1]]},
        {"epochs": True, "phases": [["learn", 1]]},
        {"epochs": 10**9, "phases": [["learn", 1]]},
        {"epochs": 1, "phases": []},
        {"epochs": 1, "phases": [["dream", 1]]},
        {"epochs": 1, "phases": [["learn", 0]]},
        {"epochs": 1, "phases": [["learn"]]},
        {"epochs": 1, "phases": 7},
        {"epochs": 1, "phases": [["learn", True]]},
        {"epochs": 1, "phases": [["learn", 1_000_001]]},
        {"epochs": 1_000_001, "phases": [["learn", 1]]},
        {"epochs": 1, "phases": [["learn", 1]], "topics": ["/hand/left/target"]},
        {"epochs": 1, "phases": [["learn", 1]], "topics": []},
    ],
)
def test_what_is_no_schedule_is_refused(fields: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        Schedule.from_dict(fields)
