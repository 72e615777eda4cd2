"""Logs turned back into an ordered stream: schedule, engine, transports and stream digests."""

import logging
from typing import TYPE_CHECKING

from recorders.lazy import lazy_names

if TYPE_CHECKING:
    from replay.diff.divergence import Divergence as Divergence
    from replay.diff.divergence import first_divergence as first_divergence
    from replay.golden.add import add_case as add_case
    from replay.golden.case import Case as Case
    from replay.golden.case import load_case as load_case
    from replay.golden.check import Verdict as Verdict
    from replay.golden.check import check_all as check_all
    from replay.golden.check import check_case as check_case
    from replay.golden.recipe import CaseSpec as CaseSpec
    from replay.golden.recipe import Runner as Runner
    from replay.sources.live import LiveLog as LiveLog
    from replay.sources.playback import Playback as Playback
    from replay.sources.playback import PlaybackConfig as PlaybackConfig
    from replay.sources.schedule import Schedule as Schedule
    from replay.sources.scheduled import EpisodeLog as EpisodeLog
    from replay.sources.scheduled import Replay as Replay
    from replay.sources.session import RecordedSession as RecordedSession
    from replay.sources.stream_digest import StreamDigest as StreamDigest
    from replay.transports.clock import Clock as Clock
    from replay.transports.clock import Paced as Paced
    from replay.transports.clock import Pausable as Pausable
    from replay.transports.clock import Unpaced as Unpaced
    from replay.transports.sender_config import SenderConfig as SenderConfig
    from replay.transports.transport import InProcess as InProcess
    from replay.transports.transport import Source as Source
    from replay.transports.transport import Transport as Transport
    from replay.transports.zenoh import ZenohTransport as ZenohTransport

_HOMES = {
    "replay.diff.divergence": ("Divergence", "first_divergence"),
    "replay.golden.add": ("add_case",),
    "replay.golden.case": ("Case", "load_case"),
    "replay.golden.check": ("Verdict", "check_all", "check_case"),
    "replay.golden.recipe": ("CaseSpec", "Runner"),
    "replay.sources.live": ("LiveLog",),
    "replay.sources.playback": ("Playback", "PlaybackConfig"),
    "replay.sources.schedule": ("Schedule",),
    "replay.sources.scheduled": ("EpisodeLog", "Replay"),
    "replay.sources.session": ("RecordedSession",),
    "replay.sources.stream_digest": ("StreamDigest",),
    "replay.transports.clock": ("Clock", "Paced", "Pausable", "Unpaced"),
    "replay.transports.sender_config": ("SenderConfig",),
    "replay.transports.transport": ("InProcess", "Source", "Transport"),
    "replay.transports.zenoh": ("ZenohTransport",),
}
"""Public names by the module that each is imported from when it is asked for."""

__all__, _get, _every = lazy_names(__name__, _HOMES)

if not TYPE_CHECKING:  # where types are checked, a name that there is not stays an error
    __getattr__, __dir__ = _get, _every

logging.getLogger(__name__).addHandler(logging.NullHandler())
