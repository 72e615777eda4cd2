"""A real Chromium for tests of the page, driven by Playwright, on a machine without a GPU too."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from playwright.sync_api import Browser, sync_playwright
from playwright.sync_api import Page as Tab
from viser import CameraHandle

from pipeline.arrays import Floats

# Software WebGL; and none of what a browser asks of its maker by itself.
_ARGUMENTS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]


def find_chromium() -> str | None:
    """Return where Chromium is, None where there is none."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


def executable() -> str:
    """Return where Chromium is; without one the test is skipped, or fails where everything is to be tested."""
    found = find_chromium()
    if found is None:
        reason = "no Chromium on this machine (Debian: apt-get install chromium): the page is not tested"
        if os.environ.get("REENACT_TEST_EVERYTHING"):
            pytest.fail(reason)
        pytest.skip(reason)
    return found


@contextmanager
def chromium(*arguments: str) -> Iterator[Browser]:
    """Run Chromium while the block runs, with more arguments of its own."""
    where = executable()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=where, args=[*_ARGUMENTS, *arguments])
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def drawn_page(address: str) -> Iterator[Tab]:
    """Have a Chromium of its own draw the page at an address while the block runs."""
    with chromium() as browser:
        tab = browser.new_page(viewport={"width": 1280, "height": 800})
        tab.goto(address)
        tab.locator("[data-reenact='visitor']").wait_for()
        yield tab


def on_screen(camera: CameraHandle, point: Floats, size: tuple[int, int]) -> tuple[float, float]:
    """Return where a point of the world [m] is on a screen of a size [pixels], as viser's camera sees it."""
    w, x, y, z = camera.wxyz
    axes = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    right, down, ahead = axes.T @ (np.asarray(point) - camera.position)
    width, height = size
    focal = 0.5 * height / np.tan(0.5 * camera.fov)
    return float(0.5 * width + focal * right / ahead), float(0.5 * height + focal * down / ahead)
