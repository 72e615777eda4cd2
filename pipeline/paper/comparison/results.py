"""Results of the comparison: errors of every exploration and rule, their intervals, and the bounds."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from pipeline.evaluation.errors import HandErrors
from pipeline.motions.names import PATTERNS
from pipeline.paper.bounds import BoundCheck, at_most, spread
from pipeline.paper.comparison.error_parts import ErrorPart
from pipeline.paper.comparison.explorations import Exploration, Explored
from pipeline.paper.comparison.rules import ComparedRule, StepCosts
from pipeline.paper.comparison.teachers import TeacherTrial

_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Figure:
    """An error over seeds [cm]: mean, standard deviation, and how far a 95 % interval of the mean reaches from it.

    There is no interval of a single seed.
    """

    mean_cm: float
    std_cm: float
    interval_cm: float | None

    @classmethod
    def of(cls, values_cm: Sequence[float]) -> "Figure":
        """Summarise errors [cm]; the interval is Student's."""
        values = np.array(values_cm)
        std_cm, interval_cm = spread(values), None
        if values.size > 1:
            quantile = stats.t.ppf(0.5 + _CONFIDENCE / 2.0, df=values.size - 1)
            interval_cm = float(quantile * std_cm / np.sqrt(values.size))
        return cls(float(values.mean()), std_cm, interval_cm)

    def to_dict(self) -> dict[str, float | None]:
        """Return the figure as JSON has it."""
        return {"mean_cm": self.mean_cm, "std_cm": self.std_cm, "interval_cm": self.interval_cm}

    def __str__(self) -> str:
        """Return mean and deviation as text."""
        return f"{self.mean_cm:.3f} ± {self.std_cm:.3f}"


@dataclass(frozen=True)
class Babbled:
    """Goal babbling for as long a time as an exploration without a teacher.

    Attributes
    ----------
    exploration : Exploration
        The exploration.
    errors : tuple of mapping of str to HandErrors
        For each seed, by motion.
    """

    exploration: Exploration
    errors: tuple[Mapping[str, HandErrors], ...]


@dataclass(frozen=True)
class Comparison:
    """Learning rules compared.

    Attributes
    ----------
    seeds : tuple of int
        Seeds of the explorations.
    explored : tuple of Explored
        What the rule forward-inverse learned from each exploration of each seed.
    missing : tuple of Exploration
        Explorations of robots whose models are not installed.
    rules : tuple of ComparedRule
        All rules, after the same explorations.
    parts : tuple of ErrorPart
        The paper's rule, with causes of its error taken away.
    costs : StepCosts or None
        Times of compiled steps; None if every exploration that the rules learn from was refused.
    babbled : tuple of Babbled
        Goal babbling beside each exploration without a teacher.
    teachers : tuple of TeacherTrial
        Both teachers on the same motions.
    """

    seeds: tuple[int, ...]
    explored: tuple[Explored, ...]
    missing: tuple[Exploration, ...]
    rules: tuple[ComparedRule, ...]
    parts: tuple[ErrorPart, ...]
    costs: StepCosts | None
    babbled: tuple[Babbled, ...] = ()
    teachers: tuple[TeacherTrial, ...] = ()

    @property
    def refused(self) -> tuple[Explored, ...]:
        """Explorations that were refused."""
        return tuple(one for one in self.explored if one.refused)

    @property
    def seconds(self) -> float:
        """Time to explore and to learn the first exploration, with nothing beside it [s]."""
        return self.explored[0].seconds

    def errors_after(self, exploration: Exploration) -> tuple[Mapping[str, HandErrors], ...]:
        """Return the errors after an exploration, for each seed that was not refused."""
        return tuple(one.errors for one in self.explored if one.exploration == exploration and not one.refused)

    def by_exploration(self) -> dict[Exploration, dict[str, Figure]]:
        """Return the figures of each exploration, by motion and hand, see `columns_of`, over the seeds not refused."""
        explorations = dict.fromkeys(one.exploration for one in self.explored if not one.refused)
        return {exploration: figures_of(self.errors_after(exploration)) for exploration in explorations}

    def summary(self) -> dict[str, Any]:
        """Return the numbers as plain JSON."""
        by_exploration = self.by_exploration()
        return {
            "seeds": list(self.seeds),
            "explorations": {one.name: _plain(figures) for one, figures in by_exploration.items()},
            "refused": [
                {"exploration": one.exploration.name, "seed": one.seed, "reason": one.refused} for one in self.refused
            ],
            "not_compared": [one.name for one in self.missing] + [one.name for one in self.rules if not one.errors],
            "rules": {one.name: _rule_summary(one) for one in self.rules if one.errors},
            "error_parts": {one.name: _plain(figures_of(one.errors)) for one in self.parts},
            "goal_babbling": {one.exploration.name: _plain(figures_of(one.errors)) for one in self.babbled},
            "teachers": [one.to_dict() for one in self.teachers],
            "learning_step_us": self.costs and self.costs.learning_us,
            "command_us": self.costs and self.costs.command_us,
            "papers_step_us": self.costs and self.costs.papers_us,
            "seconds_explore_and_learn": self.seconds,
        }

    def checks(self) -> Iterator[BoundCheck]:
        """Yield the bounds of the errors, of the worst column the mean over the seeds, and what was refused."""
        for exploration, figures in self.by_exploration().items():
            patterns = [figure.mean_cm for column, figure in figures.items() if column in PATTERNS]
            drawings = [figure.mean_cm for column, figure in figures.items() if column not in PATTERNS]
            rule = f"forward-inverse, {exploration.title}"
            yield at_most(f"{rule}: {_patterns_text(figures)}", max(patterns), exploration.patterns_cm, digits=3)
            if drawings:
                claim = f"{rule}: each hand of each drawing"
                yield at_most(claim, max(drawings), exploration.drawings_cm, digits=3)
        for one in self.refused:
            yield BoundCheck(
                f"{one.exploration.title}: seed {one.seed} explores", f"refused: {one.refused}", holds=False
            )


def columns_of(errors: Mapping[str, HandErrors]) -> dict[str, float]:
    """Return errors [cm]: of a pattern the mean of both hands, of a drawing each hand's, as `NAME_HAND`."""
    columns: dict[str, float] = {}
    for name, error in errors.items():
        if name in PATTERNS:
            columns[name] = error.mean_cm
        else:
            columns |= {f"{name}_{hand}": error_cm for hand, error_cm in error.hands_cm.items()}
    return columns


def figures_of(errors: Iterable[Mapping[str, HandErrors]]) -> dict[str, Figure]:
    """Return the figures over seeds of every column."""
    columns = [columns_of(one) for one in errors]
    return {name: Figure.of([one[name] for one in columns]) for name in columns[0]}


def drawings_figure(errors: Iterable[Mapping[str, HandErrors]], hand: str) -> Figure:
    """Return the figure of a hand over all drawings: the mean of these for each seed."""
    means = [
        float(np.mean([one.hands_cm[hand] for name, one in motions.items() if name not in PATTERNS]))
        for motions in errors
    ]
    return Figure.of(means)


def _patterns_text(figures: Mapping[str, Figure]) -> str:
    return " and ".join(column for column in figures if column in PATTERNS)


def _rule_summary(rule: ComparedRule) -> dict[str, Any]:
    return {"errors": _plain(figures_of(rule.errors)), "tick_us": rule.tick_us, "command_us": rule.command_us}


def _plain(figures: Mapping[str, Figure]) -> dict[str, dict[str, float | None]]:
    return {name: figure.to_dict() for name, figure in figures.items()}
