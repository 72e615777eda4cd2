"""Whom a sender asks what and when, and how long it waits: by its clock alone, to the moment."""

import math

import pytest

from recorders.errors import WireError
from recorders.protocol.packets import Ask, Packet
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


def test_nothing_is_due_before_the_first_is_greeted() -> None:
    questions = Questions(("anna", "bob"), 10.0)
    assert (questions.deadline_s, due(questions, 1e9)) == (math.inf, [])
    assert questions.greet_next(3.0)
    assert (questions.deadline_s, due(questions, 2.9)) == (3.0, [])
    assert due(questions, 3.0) == [("anna", "hello")]


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


def offered(questions: Questions, name: str, now_s: float) -> Ask:
    """Make the offer that is due."""
    assert due(questions, now_s) == [(name, "hello")]
    return questions.ask(name, "hello", NOTHING)


def test_an_offer_is_repeated_each_half_second_and_an_answer_to_any_of_them_counts() -> None:
    questions = Questions(("anna",), 10.0)
    questions.greet_next(3.0)
    offers = []
    for now_s in (3.0, 3.5, 4.0, 4.5):
        assert questions.deadline_s == now_s
        assert due(questions, now_s - 0.01) == []
        offers.append(offered(questions, "anna", now_s))
    assert all(questions.is_open(offer) for offer in offers)
    assert {offer.timeout_s for offer in offers} == {5.0}
    questions.has_accepted("anna", 4.6)
    assert not questions.greet_next(4.6)
    assert not any(questions.is_open(offer) for offer in offers)
    assert questions.deadline_s == 5.6


def test_an_offer_that_nobody_takes_is_made_again_soon_unless_another_may_still_be_taken() -> None:
    questions = Questions(("anna",), 10.0)
    questions.greet_next(0.0)
    questions.close(offered(questions, "anna", 0.0))
    questions.greet_later(1.0)
    assert questions.deadline_s == 1.05
    taken = offered(questions, "anna", 1.25)
    questions.close(offered(questions, "anna", 1.75))
    questions.greet_later(2.0)
    assert (questions.is_open(taken), questions.deadline_s) == (True, 2.25)


def test_another_instance_is_offered_the_stream_at_once_and_no_answer_of_the_one_before_counts() -> None:
    questions = Questions(("anna",), 10.0)
    questions.greet_next(0.0)
    earlier = offered(questions, "anna", 0.0)
    status = questions.ask("bob", "status", NOTHING)
    questions.greet_instance(b"first", 0.2)
    assert (questions.deadline_s, questions.is_open(earlier), questions.is_open(status)) == (0.2, False, True)


def pass_time(questions: Questions, begin_s: float, end_s: float, *, by_s: float = 0.5) -> float:
    """Let nobody answer until the consumer is given up, or until `end_s`; returns when that was."""
    now_s = begin_s
    while now_s < end_s and not questions.has_waited(now_s):
        for name, verb in questions.take_due(now_s):
            questions.ask(name, verb, NOTHING)
        now_s += by_s
    return now_s


@pytest.mark.parametrize(("wait_s", "given_up_s"), [(0.0, 5.5), (2.0, 5.5), (5.0, 5.5), (10.0, 10.5)])
def test_a_consumer_that_answers_nothing_is_given_up_once_one_answer_had_time(wait_s: float, given_up_s: float) -> None:
    questions = Questions(("anna",), wait_s)
    questions.greet_next(100.0)
    assert pass_time(questions, 100.0, 200.0) == 100.0 + given_up_s


@pytest.mark.parametrize(("wait_s", "given_up_s"), [(0.0, 0.25), (2.0, 2.25), (10.0, 10.25)])
def test_a_consumer_that_is_not_there_is_given_up_after_its_wait(wait_s: float, given_up_s: float) -> None:
    questions = Questions(("anna",), wait_s)
    questions.greet_next(100.0)
    now_s = 100.0
    while not questions.has_waited(now_s):
        questions.close(offered(questions, "anna", now_s))
        questions.greet_later(now_s)
        now_s += 0.25
    assert now_s == 100.0 + given_up_s


@pytest.mark.parametrize("overslept_s", [0.5, 3.0, 3_600.0])
def test_a_stall_or_a_jump_of_the_clock_is_waited_no_longer_than_for_one_offer(overslept_s: float) -> None:
    questions = Questions(("anna",), 10.0)
    questions.greet_next(0.0)
    now_s = pass_time(questions, 0.0, 4.0)
    assert pass_time(questions, now_s - 0.5 + overslept_s, 9_999.0) == 10.0 + overslept_s


def test_whoever_appears_is_waited_for_anew_but_once() -> None:
    questions = Questions(("anna", "bob"), 10.0)
    questions.greet_next(0.0)
    assert pass_time(questions, 0.0, 8.0) == 8.0
    questions.greet_instance(b"first", 8.0)
    assert pass_time(questions, 8.0, 17.0) == 17.0
    questions.greet_instance(b"second", 17.0)
    assert pass_time(questions, 17.0, 20.0) == 20.0
    questions.greet_instance(b"first", 20.0)
    assert pass_time(questions, 20.0, 99.0) == 27.5
    questions.has_accepted("anna", 27.5)
    questions.greet_next(27.5)
    assert pass_time(questions, 27.5, 99.0) == 38.0


def test_nobody_is_given_up_who_is_not_greeted() -> None:
    assert not greeted("anna").has_waited(1e9)


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
