"""Paths of the packaged data: robots and motions, in an installed wheel and in a checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def data_path(*parts: str) -> Path:
    """Path of packaged data, for example ``data_path("robots", "asimo")``.

    A wheel carries the data inside the package, as ``pipeline/_data``; a checkout has it in its top-level ``data``.
    The path is not checked to exist: the caller knows what is missing and reports it.
    """
    packaged = _PACKAGE / "_data"
    root = packaged if packaged.is_dir() else _PACKAGE.parent / "data"
    return root.joinpath(*parts)
