"""Files and folders as a whole: the hash of what a file holds, and the names in a folder brought to the disk."""

import hashlib
import os
from pathlib import Path


def file_sha256(*paths: Path) -> str:
    """Return the SHA-256 of a file, or of several one after the other."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            hashlib.file_digest(file, lambda: digest)
    return digest.hexdigest()


def sync_folder(folder: Path) -> None:
    """Have the disk take the names in a folder; raises OSError if that fails."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
