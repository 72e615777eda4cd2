"""Former spellings of options: each works for one more release, with a line that names the present one."""

from collections.abc import Callable, Mapping

from pipeline.terminal import console

RENAMED_OPTIONS: Mapping[str, Mapping[str, str]] = {
    "demonstrate": {
        "place": "align",
        "flat": "project-to-plane",
        "unreachable": "on-unreachable",
        "silence": "idle-timeout",
    },
    "golden add": {"dir": "cases"},
    "learn": {"every": "checkpoint-every"},
    "record": {"until-end": "stop-at-stream-end"},
    "replay": {"against": "compare-with", "batch": "batch-size"},
    "serve": {"beside-others": "allow-multiple"},
}
"""Present name by former name, without their dashes, of each verb that has renamed options."""


def present_name(verb: str) -> Callable[[str], str] | None:
    """Return what turns an option's name into the present one, as the parser asks for it; None if none was renamed.

    The parser asks for what it takes as an option only: never for a value, nor for anything after `--`.
    """
    renamed = RENAMED_OPTIONS.get(verb)
    if renamed is None:
        return None

    def look_up(name: str) -> str:
        """Return the present name; prints a line if it is another."""
        if name not in renamed:
            return name
        console.notice(f"--{name} is now called --{renamed[name]}")
        return renamed[name]

    return look_up
