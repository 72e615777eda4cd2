"""Numbers of publishers: what did not come is counted of each by itself, and nothing that did."""

from collections import Counter, defaultdict

from hypothesis import given, settings
from hypothesis import strategies as st

from recorders.recording.publisher_counts import MAX_PUBLISHERS, PublisherCounts


@settings(max_examples=20)
@given(
    lost=st.sets(st.tuples(st.sampled_from("ab"), st.integers(1, 9))),
    order=st.permutations([name for name in "ab" for _ in range(9)]),
)
def test_what_is_lost_between_two_messages_of_a_publisher_is_counted(
    lost: set[tuple[str, int]], order: list[str]
) -> None:
    counts, missing = PublisherCounts(), 0
    sent: Counter[str] = Counter()
    came: defaultdict[str, list[int]] = defaultdict(list)
    for name in order:
        sent[name] += 1
        if (name, sent[name]) not in lost:
            missing += counts.note("/chatter", name.encode(), sent[name])
            came[name].append(sent[name])
    rows = {bytes.fromhex(row["publisher"]).decode(): row for row in counts.rows()}
    assert rows.keys() == came.keys()
    for name, numbers in came.items():
        between = set(range(numbers[0], numbers[-1])) - set(numbers)
        assert (rows[name]["first"], rows[name]["last"]) == (numbers[0], numbers[-1])
        assert (rows[name]["messages"], rows[name]["missing"]) == (len(numbers), len(between))
    assert missing == sum(row["missing"] for row in rows.values())


def test_what_comes_again_is_nothing_lost() -> None:
    counts = PublisherCounts()
    assert [counts.note("/map", b"1", number) for number in (7, 8, 7, 8, 9, 11)] == [0, 0, 0, 0, 0, 1]
    (row,) = counts.rows()
    assert (row["messages"], row["repeated"], row["missing"]) == (6, 2, 1)


def test_topics_of_one_publisher_are_counted_apart() -> None:
    counts = PublisherCounts()
    assert [counts.note(topic, b"1", number) for topic, number in (("/a", 1), ("/b", 5), ("/a", 2), ("/b", 7))] == [
        0,
        0,
        0,
        1,
    ]


def test_publishers_without_end_cost_no_memory_without_end() -> None:
    counts = PublisherCounts()
    for number in range(MAX_PUBLISHERS + 10):
        counts.note("/a", b"honest", number)
        counts.note("/a", number.to_bytes(4, "little"), 1)
    assert len(counts.rows()) == MAX_PUBLISHERS
    assert counts.forgotten == 11
    assert counts.note("/a", b"honest", MAX_PUBLISHERS + 12) == 2
