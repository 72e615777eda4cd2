"""`info` of recordings in any container and encoding: counts, rates and stamps alike."""

import bags
import pytest

from recorders.reading.parts import find_log
from recorders.recovery.session_info import summarise_log

FORMS = {
    "ros1 bag": lambda folder: bags.ros1_bag(folder / "log.bag"),
    "ros1 mcap": lambda folder: bags.ros1_mcap(folder / "log.mcap"),
    "db3": lambda folder: bags.bag_folder(folder / "bag"),
    "json": lambda folder: bags.foxglove_json(folder / "log.mcap"),
    "cdr": lambda folder: bags.cdr_mcap(folder / "log.mcap"),
}


@pytest.mark.parametrize("form", FORMS)
def test_counts_times_and_stamps_are_the_same_in_every_form(tmp_path, form):
    summary = summarise_log(find_log(FORMS[form](tmp_path)))
    assert summary.sound
    found = {
        name: (topic.count, topic.first_ns, topic.last_ns, topic.ahead_ns) for name, topic in summary.topics.items()
    }
    last_ns = bags.START_NS + 39 * 10_000_000
    assert found == {
        bags.JOINTS: (40, bags.START_NS + 1000, last_ns + 1000, (-1000, -1000)),
        bags.POSE: (40, bags.START_NS + 1000, last_ns + 1000, (-500, -500)),
        bags.ODOMETRY: (40, bags.START_NS + 2000, last_ns + 2000, (-1500, -1500)),
        bags.TF: (10, bags.START_NS + 3000, bags.START_NS + 360_003_000, None),
    }
    assert summary.to_dict()["messages"] == 130
