import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders.errors import MessageError
from recorders.messages.message_types import String
from recorders.messages.phase import EVALUATE, LEARN, MAX_COUNT, PHASES, Phase

text = st.text(st.characters(codec="utf-8"))


def test_a_marker_is_compact_json_in_fixed_order():
    message = Phase("run-1", 2, 3, LEARN, "circles.mcap").to_message()
    assert message.data == '{"run":"run-1","epoch":2,"cycle":3,"phase":"learn","log":"circles.mcap"}'


counts = st.integers(0, MAX_COUNT - 1)


@given(st.builds(Phase, text, counts, counts, st.sampled_from(PHASES), text))
def test_markers_come_back(phase):
    assert Phase.from_message(phase.to_message()) == phase


@pytest.mark.parametrize(
    "data",
    [
        "",
        "{",
        "[]",
        "[" * 100_000,
        '{"run":"r","epoch":0,"cycle":0,"phase":"learn"}',
        '{"run":"r","epoch":0,"cycle":0,"phase":"learn","log":"","more":1}',
        '{"run":1,"epoch":0,"cycle":0,"phase":"learn","log":""}',
        '{"run":"r","epoch":0.0,"cycle":0,"phase":"learn","log":""}',
        '{"run":"r","epoch":true,"cycle":0,"phase":"learn","log":""}',
        '{"run":"r","epoch":-1,"cycle":0,"phase":"learn","log":""}',
        '{"run":"r","epoch":0,"cycle":0,"phase":"sleep","log":""}',
        '{"run":"r","epoch":0,"cycle":0,"phase":null,"log":""}',
        '{"run":"r","epoch":' + "9" * 5000 + ',"cycle":0,"phase":"learn","log":""}',
    ],
    ids=range(13),
)
def test_anything_else_is_refused(data):
    with pytest.raises(MessageError, match="phase marker"):
        Phase.from_message(String(data))


def test_an_unknown_phase_is_refused_with_those_that_exist():
    with pytest.raises(MessageError, match="there are washout, learn, evaluate"):
        Phase("r", 0, 0, "train", "")
    assert Phase("r", 0, 0, EVALUATE, "").phase == "evaluate"
