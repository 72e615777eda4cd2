"""The settings of a conversion."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from recorders.errors import ConfigError
from recorders.text.quantities import seconds_text
from recorders.text.wording import names_text

COMPRESSIONS = {"lz4": "lz4", "zstd": "zstd", "none": ""}
"""Compressions of chunks by the names of the option; MCAP's for each."""


@dataclass(frozen=True)
class ConvertConfig:
    """What is written of the recordings, and how.

    Parameters
    ----------
    topics : frozenset of str
        Patterns of topics to keep, such as `/hand/*`, by the names in the recordings; all if empty.
    renames : mapping of str to str
        Topic names to use in place of those in the recordings; no two may become one.
    start_ns, end_ns : int
        Slice of the recorded time, counted from the earliest message of all [ns]; to the end if `end_ns` is None.
    sort : bool
        Whether recordings of our own writer come in order of log time too, where their times fall.
    compression : str
        One of `COMPRESSIONS`.
    split_bytes, split_ns : int, optional
        Size of a file [bytes] or recorded time [ns] after which another one begins.

    Raises
    ------
    ConfigError
        If one is out of range.
    """

    topics: frozenset[str] = frozenset()
    renames: Mapping[str, str] = field(default_factory=dict)
    start_ns: int = 0
    end_ns: int | None = None
    sort: bool = False
    compression: str = "lz4"
    split_bytes: int | None = None
    split_ns: int | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        if self.start_ns < 0 or (self.end_ns is not None and self.end_ns <= self.start_ns):
            raise ConfigError(f"slice: expected 0 <= start < end, found {self.span}")
        if self.compression not in COMPRESSIONS:
            raise ConfigError(
                f"--compression: expected one of {names_text(COMPRESSIONS)}, found {self.compression!r:.40}"
            )

    @property
    def sliced(self) -> bool:
        """Whether a part of the recorded time is left out."""
        return self.start_ns > 0 or self.end_ns is not None

    @property
    def splits(self) -> bool:
        """Whether it goes to several files."""
        return self.split_bytes is not None or self.split_ns is not None

    @property
    def span(self) -> str:
        """The slice in words."""
        end = "the end" if self.end_ns is None else f"{seconds_text(self.end_ns)} s"
        return f"{seconds_text(self.start_ns)} s to {end}"

    def to_dict(self) -> dict[str, object]:
        """Return what decides what is in the result, for its manifest."""
        return {
            "topics": sorted(self.topics),
            "renames": dict(sorted(self.renames.items())),
            "start_ns": self.start_ns,
            "end_ns": self.end_ns,
            "sort": self.sort,
        }
