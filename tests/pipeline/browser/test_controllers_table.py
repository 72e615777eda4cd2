"""Table of controllers side by side: a row for each, what none drove yet is no figure, and names are only names."""

import numpy as np
import pytest

pytest.importorskip("viser")

from pipeline.browser.page.teaching.controllers_part import rounds_table
from pipeline.browser.session.figures import Round, TickError


def round_of(errors_cm, *, duration_s):
    found = Round(duration_s)
    for error_cm in errors_cm:
        found.add(TickError(0, np.array([error_cm, 2 * error_cm]), {}), 1.0)
    return found


def test_each_controller_has_its_figures_and_the_leading_one_a_mark():
    rounds = {"teacher": round_of([1.0, 2.0], duration_s=2.0), "learned": round_of([0.5], duration_s=4.0)}
    table = rounds_table(("left", "right"), ("teacher", "learned", "new"), rounds, leading="learned")
    rows = table.split("<tr")[2:]
    assert all(text in rows[0] for text in ('data-reenact="left:teacher">1.50 / 2.00<', ">3.00 / 4.00<", ">100 %<"))
    assert all(
        text in rows[1] for text in ('data-reenact="right:learned">1.00 / 1.00<', ">25 %<", "&#9654;&nbsp;learned")
    )
    assert all(text in rows[2] for text in (">new<", ">0 %<", "&ndash;"))
    assert "&#9654;" not in rows[0] + rows[2]


def test_a_name_is_text_and_nothing_else():
    table = rounds_table(("<b>",), ('"><script>',), {}, leading="")
    assert "<script>" not in table
    assert "<b>" not in table
