"""Digests that everybody's demo comes to, as the README has them, and the comparison with those of a run."""

import json
from collections.abc import Mapping

from pipeline.resources import data_path

FILE = "published.json"
"""In the data of the package: the demo's settings, and a digest for each log and controller that it leaves."""


def published_digests(*, seed: int, epochs: int, duration_s: float) -> dict[str, str] | None:
    """Return the published digest of each file of the demo, by name; None if none are published for these settings.

    Parameters
    ----------
    seed, epochs, duration_s : int, int, float
        Settings of a run, as `pipeline.demo.run.run_demo` has them.
    """
    published = json.loads(data_path(FILE).read_text(encoding="utf-8"))
    if (seed, epochs, duration_s) != (published["seed"], published["epochs"], published["duration_s"]):
        return None
    return dict(published["digests"])


def published_line(found: Mapping[str, str], published: Mapping[str, str] | None) -> str:
    """Return a line on whether the digests found are those published, and which are not.

    Examples
    --------
    >>> published_line({"eight.mcap": "aa"}, {"eight.mcap": "aa"})
    'As published: yes.'
    >>> published_line({"eight.mcap": "bb"}, {"eight.mcap": "aa"})
    'As published: no: eight.mcap: expected aa, found bb.'
    >>> published_line({"eight.mcap": "bb"}, None)
    'As published: not compared: nothing is published for these settings.'
    """
    if published is None:
        return "As published: not compared: nothing is published for these settings."
    differing = [
        f"{name}: expected {published.get(name, 'none')[:16]}, found {found.get(name, 'none')[:16]}"
        for name in {**published, **found}
        if published.get(name) != found.get(name)
    ]
    return f"As published: no: {'; '.join(differing)}." if differing else "As published: yes."
