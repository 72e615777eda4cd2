"""The `metadata.yaml` of a rosbag2 folder: which files hold the recording, and how."""

from pathlib import Path, PurePath
from typing import Any, NamedTuple

from recorders.errors import LogError, unreadable
from recorders.files.regular_file import require_regular_file
from recorders.text.plain_yaml import MAX_TEXT, AliasError, from_yaml
from recorders.text.wording import names_text

METADATA_FILE = "metadata.yaml"


class BagMetadata(NamedTuple):
    """What is needed of it.

    Attributes
    ----------
    storage : str
        `mcap`, `sqlite3`, or another.
    compression_mode : str
        `file`, `message`, or an empty string for none.
    files : tuple of Path
        The files of the recording, in order, all of which are there.
    """

    storage: str
    compression_mode: str
    files: tuple[Path, ...]


def is_bag_folder(folder: Path) -> bool:
    """Whether a folder is a rosbag2 recording."""
    return (folder / METADATA_FILE).is_file()


def read_bag_metadata(folder: Path) -> BagMetadata:
    """Read the metadata of a rosbag2 folder.

    Raises
    ------
    LogError
        If they are malformed, name no file, or one that is missing, or the compression is unknown.
    """
    about = _information(folder / METADATA_FILE)
    names, storage = about.get("relative_file_paths"), about.get("storage_identifier")
    modes = [about.get(f"compression_{part}") or "" for part in ("mode", "format")]
    if not (isinstance(names, list) and names and _all_texts([*names, storage])):
        raise LogError(f"{folder / METADATA_FILE}: expected the files of a rosbag2 recording, found none")
    if not _all_texts(modes):
        raise LogError(f"{folder / METADATA_FILE}: expected texts for compression_mode and compression_format")
    mode, how = (text.lower() for text in modes)
    files = tuple(folder / PurePath(name).name for name in names)
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        files_text = "file" if len(files) == 1 else f"{len(files)} files"
        raise LogError(
            f"{folder}: {names_text(missing, limit=200)} missing: expected the {files_text} that {METADATA_FILE} "
            f"names, found {len(files) - len(missing)}; copy the rest here, or name the files that you mean"
        )
    mode = "" if mode == "none" else mode
    if mode not in ("", "file", "message") or (mode and how != "zstd"):
        raise LogError(f"{folder}: expected a bag compressed with zstd by file or message, found {how!r} by {mode!r}")
    return BagMetadata(str(storage), mode, files)


def _all_texts(values: list[Any]) -> bool:
    """Whether they are strings, rather than lists whose text may be endless."""
    return all(isinstance(value, str) for value in values)


def _information(path: Path) -> dict[str, Any]:
    require_regular_file(path, expected="the metadata of a rosbag2 recording")
    try:
        with path.open("rb") as file:
            found = from_yaml(file.read(MAX_TEXT + 1))
    except OSError as error:
        raise LogError(unreadable(path, error)) from error
    except AliasError as error:
        raise LogError(f"{path}: expected the metadata of a rosbag2 recording, without aliases, found some") from error
    except ValueError:
        found = None
    about = found.get("rosbag2_bagfile_information") if isinstance(found, dict) else None
    if not isinstance(about, dict):
        raise LogError(f"{path}: expected the metadata of a rosbag2 recording, found other content")
    return about
