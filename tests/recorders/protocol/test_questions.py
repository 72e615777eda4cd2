"""Whom a sender asks what and when, and how long it waits: by its clock alone, to the moment."""

import math

import pytest

from recorders.errors import WireError
from recorders.protocol.packets import Packet
from recorders.protocol.patience import Patience
from recorders.protocol.questions import Questions

NOTHING = Packet(b"")


def due(questions: Questions, now_s: float) -> list[tuple[str, str]]:
    return list(questions.take_due(now_s))


def greeted(*names: str, wait_s: float = 10.0) -> Questions:
    """Questions to consumers that have all accepted, at 0 s."""
    questions = Questions(names, wait_s)
    for name in names:
        assert questions.greet_next(0.0)
        assert due(questions, 0.0) == [(name, "hello")]
        questions.has_accepted(name, 0.0)
    assert not questions.greet_next(0.0)
    return questions


def test_nothing_is_due_before_the_first_is_greeted_nor_while_an_answer_is_awaited() -> None:
    questions = Questions(("anna", "bob"), 10.0)
    assert (questions.deadline_s, due(questions, 1e9)) == (math.inf, [])
    assert questions.greet_next(3.0)
    assert (questions.deadline_s, due(questions, 2.9)) == (3.0, [])
    assert due(questions, 3.0) == [("anna", "hello")]
    assert (questions.deadline_s, due(questions, 1e9)) == (math.inf, [])


def test_each_is_asked_a_second_after_its_last_answer_and_once_at_a_time() -> None:
    questions = greeted("anna", "bob")
    assert questions.deadline_s == 1.0
    assert due(questions, 0.9) == []
    assert due(questions, 1.0) == [("anna", "status"), ("bob", "status")]
    assert (questions.deadline_s, due(questions, 1e9)) == (math.inf, [])
    questions.ask_later("bob", 5.0)
    assert questions.deadline_s == 6.0


def test_who_has_published_that_it_is_through_is_asked_at_once_but_once() -> None:
    questions = greeted("anna")
    questions.confirm("nobody", 0.1)
    questions.confirm("anna", 0.2)
    assert questions.deadline_s == 0.2
    assert due(questions, 0.2) == [("anna", "status")]
    questions.confirm("anna", 0.3)  # while it is asked
    assert questions.deadline_s == math.inf
    questions.ask_later("anna", 0.4)
    assert questions.deadline_s == 0.4
    assert due(questions, 0.4) == [("anna", "status")]
    questions.ask_later("anna", 0.5)
    assert questions.deadline_s == 1.5


def test_who_was_started_anew_is_greeted_and_asked_nothing_else() -> None:
    questions = greeted("anna", "bob")
    assert questions.has_restarted("bob")
    assert not questions.has_restarted("anna")
    assert questions.ungreeted == ["bob", "anna"]
    questions.greet_next(7.0)
    assert due(questions, 100.0) == [("bob", "hello")]


def test_who_has_accepted_is_taken_and_nothing_is_due_or_awaited_any_more() -> None:
    questions = greeted("anna", "bob")
    asked = questions.ask("anna", "status", NOTHING)
    waited = questions.are_all_answered
    assert questions.take_accepted() == ["anna", "bob"]
    assert questions.deadline_s == math.inf
    assert [waited, questions.are_all_answered] == [False, True]
    assert not questions.is_open(asked)


def test_an_answer_counts_once_and_each_question_has_a_number_of_its_own() -> None:
    questions = greeted("anna")
    asked = [questions.ask("anna", verb, NOTHING) for verb in ("hello", "status", "status")]
    assert len({ask.number for ask in asked}) == 3
    questions.close(asked[1])
    assert [questions.is_open(ask) for ask in asked] == [True, False, True]
    assert not questions.are_all_answered


@pytest.mark.parametrize(("wait_s", "hello_s"), [(0.0, 1.0), (5.0, 1.0), (10.0, 2.0)])
def test_an_offer_is_repeated_five_times_in_the_time_that_its_answer_may_take(wait_s: float, hello_s: float) -> None:
    questions = Questions(("anna",), wait_s)
    assert questions.ask("anna", "hello", NOTHING).timeout_s == hello_s
    assert questions.ask("anna", "status", NOTHING).timeout_s == 5.0


def test_an_offer_that_nobody_takes_is_made_again_soon_and_one_of_another_instance_at_once() -> None:
    questions = Questions(("anna",), 10.0)
    questions.greet_next(0.0)
    due(questions, 0.0)
    assert questions.greet_later(0.0)
    assert questions.deadline_s == 0.05
    due(questions, 0.05)
    assert questions.greet_later(0.06, at_once=True)
    assert questions.deadline_s == 0.06


@pytest.mark.parametrize(
    ("wait_s", "asked_s", "answered_s", "goes_on"),
    [
        (2.0, 101.5, 102.0, True),  # that nobody is there is known at once: it may appear up to 102 s
        (2.0, 101.5, 102.01, False),
        (2.0, 101.5, 102.49, False),
        (2.0, 101.5, 102.5, True),  # or the answer was lost, and takes as long as any other
        (2.0, 101.5, 105.0, True),
        (2.0, 101.5, 105.01, False),
        (10.0, 104.0, 110.0, True),
        (10.0, 104.0, 110.01, False),
        (10.0, 109.0, 110.01, False),
    ],
)
def test_a_consumer_that_does_not_appear_is_given_up(
    wait_s: float, asked_s: float, answered_s: float, goes_on: bool
) -> None:
    questions = Questions(("anna",), wait_s)
    questions.greet_next(100.0)
    due(questions, asked_s)
    assert questions.greet_later(answered_s) == goes_on


def test_patience_is_tried_by_what_is_lacking_for_long_and_by_nothing_else() -> None:
    patience = Patience(30.0)
    tried = [patience.is_tried]
    patience.begin()
    assert [*tried, patience.is_tried] == [False, True]
    assert not patience.lacks("anna", 3, 100.0, lacking=True)
    assert not patience.lacks("bob", 3, 100.0, lacking=True)
    assert patience.lacks("anna", 3, 101.0, lacking=True)
    patience.begin()  # again changes nothing
    assert patience.lacks("anna", 3, 130.0, lacking=True)
    with pytest.raises(WireError, match=r"anna: message 3 does not arrive for 30 s; the rest of the stream is unconf"):
        patience.lacks("anna", 3, 130.01, lacking=True)
    assert not patience.lacks("bob", 4, 140.0, lacking=True)
    assert patience.lacks("bob", 4, 170.0, lacking=True)
    assert not patience.lacks("bob", 4, 180.0, lacking=False)
    assert patience.lacks("bob", 4, 210.0, lacking=True)
    assert not patience.lacks("bob", None, 220.0, lacking=True)
    with pytest.raises(WireError, match=r"bob: no answer for 30 s; the rest of the stream is unconfirmed"):
        patience.lacks("bob", None, 250.01, lacking=True)


def test_patience_begins_anew_after_it_has_ended() -> None:
    patience = Patience(30.0)
    patience.begin()
    patience.lacks("anna", 3, 100.0, lacking=True)
    patience.end()
    assert not patience.is_tried
    patience.begin()
    assert not patience.lacks("anna", 3, 200.0, lacking=True)
    assert patience.lacks("anna", 3, 230.0, lacking=True)
