"""Learning rules by name: our own modules, and entry points `reenact.rules` of what is installed beside us.

A name that a file gives is looked up among these and never imported for itself.
"""

from collections.abc import Mapping
from typing import Any

from pipeline.learner import rules
from pipeline.learner.rule import DEFAULT, OnlineLearner, Rule, Settings
from recorders.errors import ConfigError
from recorders.registry import Registry
from recorders.text.wording import value_text

KEY = "rule"
"""Setting of a configuration that names its rule; absent for `DEFAULT`."""


RULES = Registry("learning rule", Rule, room=rules, constant="RULE", group="reenact.rules")


def rule_names() -> tuple[str, ...]:
    """Return the names of all rules, our own first."""
    return RULES.names()


def find_rule(name: str) -> Rule:
    """Return a rule by its name.

    Raises
    ------
    ConfigError
        If there is none, or what is installed under this name is none.
    """
    return RULES.find(name)


def config_from_dict(values: Mapping[str, Any]) -> Settings:
    """Make the configuration of any rule from plain values, which may name the rule.

    Raises
    ------
    ConfigError
        If the rule or a key is unknown, or a value is of the wrong type or out of its range.
    """
    name = values.get(KEY, DEFAULT)
    if type(name) is not str:
        raise ConfigError(f"expected learner setting {KEY} to be a text, found {value_text(name)}")
    return find_rule(name).config.from_dict({key: value for key, value in values.items() if key != KEY})


def config_to_dict(config: Settings) -> dict[str, Any]:
    """Return a configuration as plain values, ready for JSON or TOML; the default rule is not named."""
    named = {} if config.rule == DEFAULT else {KEY: config.rule}
    return named | config.to_dict()


def default_config(rule: str | None = None, **settings: int) -> Settings:
    """Return the configuration of a rule, `DEFAULT` if none is named, with some settings other than its defaults.

    Raises
    ------
    ConfigError
        If there is no such rule or setting.
    """
    return config_from_dict({KEY: DEFAULT if rule is None else rule, **settings})


def make_learner(config: Settings, **centres: Any) -> OnlineLearner:
    """Make a learner of a configuration's rule; `centres` are `input_centre` and `output_centre`."""
    return find_rule(config.rule).learner(config, **centres)
