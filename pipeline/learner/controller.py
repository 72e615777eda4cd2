"""A learned controller as one file: configuration, constants, state, robot and provenance in an .npz.

The file is a zip of .npy members, so that `numpy.load(path)` opens it anywhere; everything that is not an array is
JSON in the member `header`. Which connections exist is drawn again from the seed rather than stored: the
drawing is a fixed integer computation, and a digest in the header shows if it ever changed.
"""

import dataclasses
import json
import math
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import numpy as np

from pipeline.arrays import Floats
from pipeline.learner import npz
from pipeline.learner.registry import config_from_dict, config_to_dict, make_learner
from pipeline.learner.rule import DEFAULT_PAIRS, OnlineLearner, Settings
from pipeline.learner.state import check_state, state_digest
from recorders.errors import ConfigError, ControllerError, file_reason
from recorders.files.anonymous_file import AnonymousFile, write_whole
from recorders.files.regular_file import begins_with, require_regular_file
from recorders.reading.file_kind import LOG_KIND, ZIP_MAGIC, mixed_up_kind
from recorders.text.wording import json_fault_text, kind_text, names_text, value_text

FORMAT = "reenact-controller"
VERSION = 1
MAX_HEADER_BYTES = 4 * 2**20  # robots take at most one million
_HEADER = "header"
_CONSTANTS = ("input_centre", "output_centre", "pending")
_HEADER_TEXTS = ("robot_toml", "robot_urdf", "state_digest", "connections_digest")


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Controller:
    """Everything needed to run, check and explain a learned controller; arrays are copied and read-only.

    Parameters
    ----------
    config : Settings
        Configuration of the learner, which names its rule.
    input_centre, output_centre : ndarray, shapes (inputs,) and (outputs,)
        Constants that centre inputs and outputs [m, rad].
    joints : tuple of str
        Joint names, in the order of the last outputs [rad]; the outputs before them predict the next u [m].
    robot_toml, robot_urdf : str
        The robot's configuration and description, as text.
    state : mapping of str to ndarray
        State of the learner, see `OnlineLearner.state`.
    pending : ndarray, shape (inputs,) or (0,)
        The u that waits for its target, empty if none does.
    provenance : mapping
        Where it came from, plain JSON values given by the caller: logs, digests, versions.
    pairs : str
        Name of the pairing rule that it was trained with.

    Raises
    ------
    ControllerError
        If parts do not fit one another.
    """

    config: Settings
    input_centre: Floats
    output_centre: Floats
    joints: tuple[str, ...]
    robot_toml: str
    robot_urdf: str
    state: Mapping[str, Floats]
    pending: Floats
    provenance: Mapping[str, Any]
    pairs: str = DEFAULT_PAIRS

    def __post_init__(self) -> None:
        inputs, outputs = self.config.inputs, self.config.outputs
        if inputs + len(self.joints) != outputs or len(set(self.joints)) != len(self.joints):
            raise ControllerError(
                f"expected {outputs - inputs} different joints for {outputs} outputs, found {len(self.joints)}"
            )
        shapes = {"input_centre": {(inputs,)}, "output_centre": {(outputs,)}, "pending": {(inputs,), (0,)}}
        for name, allowed in shapes.items():
            values = getattr(self, name)
            if np.shape(values) not in allowed or not np.isfinite(values).all():
                raise ControllerError(
                    f"expected {name} of shape {(*allowed,)[0]}, finite; found shape {np.shape(values)}"
                )
            object.__setattr__(self, name, _frozen(values))
        arrays = self.config.state_shapes()
        check_state(arrays, self.state)
        object.__setattr__(self, "state", {name: _frozen(self.state[name]) for name in arrays})

    @classmethod
    def from_learner(
        cls,
        learner: OnlineLearner,
        *,
        joints: tuple[str, ...],
        robot_toml: str,
        robot_urdf: str,
        pending: Floats | None = None,
        provenance: Mapping[str, Any] | None = None,
        pairs: str = DEFAULT_PAIRS,
    ) -> Self:
        """Take a learner's present state; `pending` is the u that waits for its target."""
        return cls(
            config=learner.config,
            input_centre=learner.input_centre,
            output_centre=learner.output_centre,
            joints=tuple(joints),
            robot_toml=robot_toml,
            robot_urdf=robot_urdf,
            state=learner.state(),
            pending=np.empty(0) if pending is None else pending,
            provenance=dict(provenance or {}),
            pairs=pairs,
        )

    @property
    def rule(self) -> str:
        """Name of the learning rule."""
        return self.config.rule

    @property
    def digest(self) -> str:
        """State digest, pending u included: 64 hexadecimal digits."""
        return state_digest(self.state, self.pending)

    def learner(self) -> OnlineLearner:
        """Make a learner at this state."""
        learner = make_learner(self.config, input_centre=self.input_centre, output_centre=self.output_centre)
        learner.load_state(self.state)
        return learner

    def adaptive(self) -> Self:
        """Return the controller that goes on learning as it serves: its rule may have parts that nothing taught yet."""
        config = self.config.adaptive()
        if config == self.config:
            return self
        learner = make_learner(config, input_centre=self.input_centre, output_centre=self.output_centre)
        return dataclasses.replace(self, config=config, state={**learner.state(), **self.state})

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the file, whole or not at all; equal controllers give equal bytes.

        Raises
        ------
        ControllerError
            If the file cannot be written, or the provenance is not plain JSON or too large.
        ConfigError
            If the state is too large for a file.
        """
        header = {
            "format": FORMAT,
            "version": VERSION,
            "config": config_to_dict(self.config),
            "joints": list(self.joints),
            "robot_toml": self.robot_toml,
            "robot_urdf": self.robot_urdf,
            "state_digest": self.digest,
            "connections_digest": self.learner().connections_digest(),
            "provenance": self.provenance,
        }
        if self.pairs != DEFAULT_PAIRS:
            header["pairs"] = self.pairs
        try:
            text = json.dumps(header, allow_nan=False, sort_keys=True)
        except (TypeError, ValueError, RecursionError) as error:
            raise ControllerError(f"expected a provenance of plain JSON values: {error}") from error
        self.config.check_size()
        if len(text) > MAX_HEADER_BYTES:
            raise ControllerError(
                f"cannot write controller {path}: expected robot and provenance of at most {MAX_HEADER_BYTES} bytes, "
                f"found {len(text)}"
            )
        constants = {name: getattr(self, name) for name in _CONSTANTS}
        with _naming_the_file(Path(path)):
            write_whole(Path(path), npz.pack({_HEADER: text, **constants, **self.state}))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a file written by `save`.

        Raises
        ------
        ControllerError
            If the file is missing, is not such a file, or does not agree with its own digests.
        """
        require_regular_file(Path(path), expected="a controller", error=ControllerError)
        try:
            data = _read(Path(path))
            if mixed_up_kind(data) == LOG_KIND:
                raise ControllerError(f"expected a controller (.npz), found {LOG_KIND}")
            return cls._parse(npz.Npz(data))
        except (ControllerError, ConfigError) as error:
            raise ControllerError(f"cannot use controller {path}: {error}") from error

    @classmethod
    def _parse(cls, file: npz.Npz) -> Self:
        header = _parse_header(file)
        config = config_from_dict(header["config"])
        config.check_size()
        arrays = _read_arrays(file, config)
        controller = cls(
            config=config,
            **{name: arrays.pop(name) for name in _CONSTANTS},
            joints=tuple(header["joints"]),
            robot_toml=header["robot_toml"],
            robot_urdf=header["robot_urdf"],
            state=arrays,
            provenance=header["provenance"],
            pairs=header.get("pairs", DEFAULT_PAIRS),
        )
        _check_digest("state", header["state_digest"], controller.digest)
        _check_digest("connections", header["connections_digest"], controller.learner().connections_digest())
        return controller


def _frozen(values: Floats) -> Floats:
    copy = np.array(values, dtype=np.float64)
    copy.flags.writeable = False
    return copy


def _read_arrays(file: npz.Npz, config: Settings) -> dict[str, Floats]:
    """Read the arrays of a controller of this configuration; one of another size is not even unpacked."""
    constants = {"input_centre": (config.inputs,), "output_centre": (config.outputs,), "pending": (config.inputs,)}
    arrays: dict[str, Floats] = {}
    for name, shape in {**constants, **config.state_shapes()}.items():
        if name not in file.names:
            raise ControllerError(f"expected array {name}, found {names_text(file.names)}")
        if not (file.holds(name, math.prod(shape)) or (name == "pending" and file.holds(name, 0))):
            raise ControllerError(f"expected {name} of shape {shape}, found another size")
        values = file.read(name)
        if isinstance(values, str):
            raise ControllerError(f"expected {name} of shape {shape}, found a text")
        arrays[name] = values
    if unknown := [name for name in file.names if name not in arrays and name != _HEADER]:
        raise ControllerError(f"expected arrays {names_text(arrays)}, found {unknown[0]!r:.80} beside them")
    return arrays


def _parse_header(file: npz.Npz) -> dict[str, Any]:
    text = file.read(_HEADER, most=MAX_HEADER_BYTES) if _HEADER in file.names else None
    if not isinstance(text, str):
        raise ControllerError("expected a member header.npy with JSON, found none")
    try:
        header = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ControllerError(f"its header is not JSON: {json_fault_text(error)}") from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ControllerError(f"its header does not name the format {FORMAT}")
    if type(header.get("version")) is not int or header["version"] != VERSION:
        raise ControllerError(f"expected format version {VERSION}, found {value_text(header.get('version'))}")
    kinds = {"config": dict, "joints": list, "provenance": dict, **dict.fromkeys(_HEADER_TEXTS, str)}
    kinds |= {"pairs": str} if "pairs" in header else {}
    for name, kind in kinds.items():
        if not isinstance(header.get(name), kind):
            raise ControllerError(
                f"expected {name} in its header to be {kind_text(kind)}, found {value_text(header.get(name))}"
            )
    if not all(isinstance(joint, str) for joint in header["joints"]):
        raise ControllerError("expected joint names in its header to be strings")
    return header


def _check_digest(name: str, expected: str, found: str) -> None:
    if expected != found:
        raise ControllerError(f"its {name} digest is {found[:12]}, but its header has {expected[:12]}")


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > npz.MAX_BYTES:
            raise ControllerError(f"expected at most {npz.MAX_BYTES} bytes, found {path.stat().st_size}")
        with path.open("rb") as file:
            return file.read(npz.MAX_BYTES)
    except OSError as error:
        raise ControllerError(file_reason(error)) from error


def is_controller(path: Path) -> bool:
    """Whether a file is a controller by its name, or begins as one does, whatever it is called."""
    if path.suffix.lower() == ".npz":
        return True
    return path.is_file() and begins_with(path, ZIP_MAGIC)


def check_writable(path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Check that a controller can be saved as `path`, before the work that makes one; leaves nothing behind.

    A controller may take the place of an empty file and, with `overwrite`, of another one; of nothing else.

    Raises
    ------
    ControllerError
        If the folder is missing or cannot be written to, or `path` names something else than a file, or a file that
        is no controller or may not be replaced.
    """
    if not Path(path).parent.is_dir():
        raise ControllerError(f"cannot write controller {path}: expected a folder {Path(path).parent}, found none")
    with _naming_the_file(Path(path)):
        AnonymousFile(Path(path)).discard()
        if _holds_something_else(Path(path)):
            raise ControllerError(
                f"cannot write controller {path}: there is a file that is no controller, which stays as it is; "
                "choose another name"
            )
        if not overwrite and Path(path).exists() and Path(path).stat().st_size:
            raise ControllerError(f"{path} exists: choose another name, or replace it with --overwrite")


def _holds_something_else(path: Path) -> bool:
    """Whether there is a file whose loss would be one, as it is no controller."""
    if not path.exists() or path.stat().st_size == 0:
        return False
    try:
        _parse_header(npz.Npz(_read(path)))
    except ControllerError:
        return True
    return False


@contextmanager
def _naming_the_file(path: Path) -> Iterator[None]:
    """Raise ControllerError if a controller cannot be written as `path`, or what the block does for it fails."""
    try:
        if not path.name or not _may_be_replaced(path):
            raise ControllerError(f"cannot write controller {path}: expected the name of a file, found something else")
        yield
    except (OSError, ValueError) as error:  # ValueError: a name that no system can have
        raise ControllerError(f"cannot write controller {path}: {getattr(error, 'strerror', None) or error}") from error


def _may_be_replaced(path: Path) -> bool:
    """Whether there is a file, or nothing: a folder cannot be, and a device must not be."""
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except FileNotFoundError:
        return True
