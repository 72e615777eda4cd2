"""An arm64 machine of this one: QEMU in user mode, Debian's Python, locked wheels; in one folder, nothing installed.

apt keeps its lists, its cache and its idea of the architecture in that folder too, so that those of this machine stay
as they are, and takes packages from the same servers. No root is needed.
"""

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

TREE = Path(__file__).parents[2]
LOCK = TREE / "requirements-core.lock"

_PYTHONS = ("python3.11", "python3.12", "python3.13")
_LIBRARIES = ("libstdc++6", "libgomp1")  # which wheels take for granted
_QEMU, _QEMU_PACKAGE = "qemu-aarch64-static", "qemu-user-static"
_GLIBC = (28, 27, 17)  # manylinux tags of wheels that Debian 12 and later can load
_SITE = "site-packages"


class MissingError(Exception):
    """Something that an emulated machine is made of is not here: one line, with what would help."""


class EmulatedMachine:
    """Runs Python programs as an arm64 processor would; made on first use, and there from then on.

    Parameters
    ----------
    folder : Path
        Where it is, outside of any source.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._root = folder / "root"

    def make(self) -> None:
        """Fetch and unpack what is not there yet.

        Raises
        ------
        MissingError
            If apt or pip are not here, or do not offer what is needed.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        self._make_root()
        self._qemu()
        self._make_site()

    def command(self, *arguments: object) -> list[str]:
        """Return the command that runs Python there with these arguments."""
        python = self._root / "usr" / "bin" / self._python_name()
        return [str(self._qemu()), "-L", str(self._root), str(python), *map(str, arguments)]

    @property
    def environment(self) -> dict[str, str]:
        """The environment that such a command needs."""
        site = self._site()
        paths = (TREE, TREE / "tests" / "support", site, site / "cmeel.prefix" / "lib" / self._python_name() / _SITE)
        return os.environ | {
            "PYTHONPATH": os.pathsep.join(map(str, paths)),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(self._folder / "numba"),
        }

    def _make_root(self) -> None:
        if any(self._pythons()):
            return None
        apt = _Apt(self._folder / "apt_arm64", "arm64")
        for python in _PYTHONS:
            if found := apt.fetch((python, *_LIBRARIES)):
                return self._unpack(found, self._root)
        raise MissingError(f"apt offers none of {', '.join(_PYTHONS)} for arm64: expected Debian's package sources")

    def _unpack(self, archives: Sequence[Path], folder: Path) -> None:
        """Unpack packages beside where they go, so that what is cut short is not taken for whole."""
        part = folder.with_name(f"{folder.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        for archive in archives:
            subprocess.run(["dpkg-deb", "-x", archive, part], check=True)
        part.rename(folder)

    def _pythons(self) -> list[str]:
        return [name for name in _PYTHONS if (self._root / "usr" / "bin" / name).exists()]

    def _python_name(self) -> str:
        return self._pythons()[0]

    def _qemu(self) -> Path:
        """Return QEMU's program for arm64: this machine's, or one that is fetched."""
        if installed := shutil.which(_QEMU):
            return Path(installed)
        folder = self._folder / "qemu"
        if not folder.exists():
            found = _Apt(self._folder / "apt_host").fetch((_QEMU_PACKAGE,))
            if not found:
                raise MissingError(f"{_QEMU} is not installed, and apt offers no {_QEMU_PACKAGE}: install it")
            self._unpack(found, folder)
        return folder / "usr" / "bin" / _QEMU

    def _site(self) -> Path:
        """Return the folder of the wheels: of this lock file, for that Python."""
        lock = hashlib.sha256(LOCK.read_bytes()).hexdigest()[:12]
        return self._folder / f"{self._python_name()}_{lock}"

    def _make_site(self) -> None:
        """Install the wheels for arm64 that the lock file names by hash."""
        site = self._site()
        if site.exists():
            return
        part = site.with_name(f"{site.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        platforms = [f"--platform=manylinux_2_{minor}_aarch64" for minor in _GLIBC]
        version = self._python_name().removeprefix("python")
        tags = [*platforms, "--platform=manylinux2014_aarch64", f"--python-version={version}", "--implementation=cp"]
        options = ["--quiet", "--no-compile", "--no-deps", "--only-binary=:all:", "--require-hashes", "-r", str(LOCK)]
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", f"--target={part}"]
        done = subprocess.run([*pip, *tags, *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode:
            raise MissingError(f"pip cannot install the wheels of {LOCK.name} for arm64: {_last_line(done.stdout)}")
        part.rename(site)


class _Apt:
    """apt with lists, cache and installed packages (none) of its own.

    Parameters
    ----------
    folder : Path
        Where all that is.
    architecture : str, optional
        Of the packages that it sees; that of this machine if left out.
    """

    def __init__(self, folder: Path, architecture: str | None = None) -> None:
        for tool in ("apt-get", "dpkg-deb"):
            if not shutil.which(tool):
                raise MissingError(f"{tool} is not here: expected Debian or one of its kind, to take packages from")
        self._archives = folder / "cache" / "archives"
        for needed in (folder / "state" / "lists" / "partial", self._archives / "partial"):
            needed.mkdir(parents=True, exist_ok=True)
        status = folder / "status"
        status.touch()
        settings = {
            "Dir::State": folder / "state",
            "Dir::State::status": status,
            "Dir::Cache": folder / "cache",
            "APT::Sandbox::User": "root",
            "Acquire::Languages": "none",
        }
        if architecture is not None:
            settings |= {"APT::Architecture": architecture, "APT::Architectures": architecture}
        self._options = [f"-o{name}={value}" for name, value in settings.items()]
        self._listed = False

    def fetch(self, packages: Sequence[str]) -> list[Path]:
        """Fetch packages and all that they depend on; returns their files, none if one is not offered."""
        if not self._listed:
            self._run("update")  # a source that has nothing for an architecture is no failure
            self._listed = True
        options = ("--yes", "--download-only", "--no-install-recommends")
        return sorted(self._archives.glob("*.deb")) if self._run("install", *options, *packages) else []

    def _run(self, *arguments: str) -> bool:
        done = subprocess.run(["apt-get", *self._options, *arguments], stdin=subprocess.DEVNULL, capture_output=True)
        return done.returncode == 0


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ["no reason given"])[-1]
