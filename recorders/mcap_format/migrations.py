"""Manifests of older log formats, brought up to the present one, a step for each version."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

Manifest = dict[str, Any]


def _from_1(manifest: Manifest) -> Manifest:
    """Format 1 did not count messages by topic, and had its manifest at the end alone."""
    return {**manifest, "format_version": 2, "counts": None}


UPGRADES: Mapping[int, Callable[[Manifest], Manifest]] = MappingProxyType({1: _from_1})
"""Functions that turn a manifest of one version into one of the next, by the version that they take.

None changes the manifest that it is given.
"""


def upgrade(manifest: Manifest) -> Manifest:
    """Return a manifest as the newest format has it; its `format_version` is one that there has been."""
    while (step := UPGRADES.get(manifest["format_version"])) is not None:
        manifest = step(manifest)
    return manifest
