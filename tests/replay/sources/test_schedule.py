"""A schedule is the paper's by default, and refuses what is not one."""

import pytest

from recorders.errors import ConfigError
from replay.sources.schedule import Schedule


def test_an_epoch_is_the_papers() -> None:
    phases = [phase for _, phase in Schedule().cycles_of_epoch()]
    assert phases == ["washout", "learn", "learn", "learn", "learn", "learn", "evaluate"]
    assert [cycle for cycle, _ in Schedule().cycles_of_epoch()] == list(range(7))
    assert Schedule().epochs == 150


def test_it_survives_json() -> None:
    schedule = Schedule(epochs=3, phases=(("learn", 2), ("evaluate", 1)))
    assert Schedule.from_dict(schedule.to_dict()) == schedule


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
    ],
)
def test_what_is_no_schedule_is_refused(fields: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        Schedule.from_dict(fields)
