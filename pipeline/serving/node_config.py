"""Settings of the node `serve`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.alignment.config import AlignmentConfig
from pipeline.learner.controller import Controller
from pipeline.robot.config import TOML_FILE, URDF_FILE
from pipeline.serving.config import ServingConfig
from recorders.wire.keys.namespace import check_name
from recorders.wire.keys.topic_keys import NamespaceKeys, TopicKeys
from recorders.writing.writer import LogWriter


@dataclass(frozen=True)
class ServeConfig:
    """Name, keys, log and ports of a served controller.

    Parameters
    ----------
    name : str
        Part of the keys of the liveliness token and of the status.
    keys : TopicKeys
        Keys of the topics, and the namespace.
    serving : ServingConfig
        Learning, washout, what is reported.
    record : Path, optional
        Log to write: the complete ticks that were answered, and the commands.
    overwrite : bool
        Whether a log of this name may be replaced.
    allow_multiple : bool
        Whether to serve in a namespace in which others of other names serve: all of them then send commands.
    metrics_port : int, optional
        Port on 127.0.0.1 for Prometheus.
    alignment : AlignmentConfig, optional
        How topics with rates and stamps of their own are aligned; if left out, ticks are taken as they are published.
    renames : mapping of str to str
        Our topic names for those that are published.
    use_sim_time : bool
        Whether messages arrive at the time of `/clock`: for the log, and for an alignment by times of recording.

    Raises
    ------
    WireError
        If the name cannot be part of a key.
    """

    name: str = "controller"
    keys: TopicKeys = field(default_factory=NamespaceKeys)
    serving: ServingConfig = field(default_factory=ServingConfig)
    record: Path | None = None
    overwrite: bool = False
    allow_multiple: bool = False
    metrics_port: int | None = None
    alignment: AlignmentConfig | None = None
    renames: Mapping[str, str] = field(default_factory=dict)
    use_sim_time: bool = False

    def __post_init__(self) -> None:
        check_name(self.name)

    @property
    def namespace(self) -> str:
        """First part of the control keys."""
        return self.keys.namespace

    def log(self, controller: Controller) -> LogWriter | None:
        """Return the log of a controller that is served, None if there is to be none; raises LogError."""
        if self.record is None:
            return None
        return LogWriter(
            self.record,
            manifest={
                "kind": "serving",
                "name": self.name,
                "controller": controller.digest,
                "learning": self.serving.learn,
                "washout_steps": self.serving.washout_steps,
            },
            attachments={URDF_FILE: controller.robot_urdf.encode(), TOML_FILE: controller.robot_toml.encode()},
            overwrite=self.overwrite,
            rechunk=False,
        )
