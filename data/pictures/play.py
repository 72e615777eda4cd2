"""Makes pictures of the page of `reenact play`: `play.png`, `teach.png`, and `play.gif` of a hand that is dragged.

Needs what `make test` installs and Debian's Chromium: `PYTHONPATH=tests/support python data/pictures/play.py [FOLDER]`.
"""

import io
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from chromium import chromium, on_screen
from PIL import Image
from waiting import wait_until

from pipeline.browser.page.gate import Gate
from pipeline.browser.page.page import Page, served_page
from pipeline.browser.session.controllers import TEACHER
from pipeline.browser.session.play import PlayConfig, playing

MAX_BYTES = 1_000_000
"""No picture is larger."""

_SIZE = (1280, 800)
_PART = {"x": 330, "y": 150, "width": 560, "height": 440}
_FRAMES, _FRAME_MS = 14, 90
_LONG_S = 600.0
_ON = "Joints between their limits"  # below what teaches
_NOTICE = "button.mantine-Notification-closeButton"  # that there is no GPU


def learned(folder: Path) -> Path:
    """Return a controller that has learned from a minute of exploration."""
    log, controller = folder / "volume.mcap", folder / "learned.npz"
    for arguments in (
        ("explore", "--motion", "volume", "--duration", "60", "--out", str(log)),
        ("train", str(log), "--rule", "forward-inverse", "--out", str(controller)),
    ):
        subprocess.run([sys.executable, "-m", "pipeline", *arguments], check=True, stdout=subprocess.DEVNULL)  # noqa: S603
    return controller


def await_still(page: Page) -> None:
    """Wait until the hands are where they are wanted."""

    def is_still() -> bool:
        now = page.play.drive.snapshot()
        return bool(np.abs(now.targets - now.wanted).max() < 1e-4 and now.error and now.error.distances_cm.max() < 0.2)

    wait_until(is_still)


def dragged(page: Page, tab: Any) -> list[Image.Image]:
    """Return pictures of a hand that is dragged out, up and back."""
    camera, robot = next(iter(page._server.get_clients().values())).camera, page.play.robot
    frames: list[Image.Image] = []
    for axis, metres in ((robot.lateral, -0.14), (robot.up, 0.16), (robot.lateral, 0.14), (robot.up, -0.16)):
        grip = page.scene.handle_position(1) + 0.1 * axis
        tab.mouse.move(*on_screen(camera, grip, _SIZE))
        tab.mouse.down()
        for share in np.linspace(0.0, 1.0, _FRAMES):
            tab.mouse.move(*on_screen(camera, grip + share * metres * axis, _SIZE))
            time.sleep(_FRAME_MS / 1000.0)
            frames.append(Image.open(io.BytesIO(tab.screenshot(clip=_PART))).convert("RGB"))
        tab.mouse.up()
    return frames


def drives(page: Page, name: str) -> bool:
    """Return whether a controller leads."""
    return page.play.link.controller == name


def has_driven(page: Page, name: str) -> bool:
    """Return whether a controller has driven a whole round."""
    found = page.play.drive.rounds().get(name)
    return found is not None and found.is_whole


def taught(page: Page, tab: Any) -> bytes:
    """Return a picture of the page as it learns, after controllers have driven a round each."""
    play, teaching = page.play, page.teaching
    play.go_through("eight")
    teaching.explore(60.0)
    wait_until(lambda: teaching.lesson is None, timeout_s=_LONG_S)
    for name in ("self-taught-1", "learned", TEACHER):
        play.choose(name)
        wait_until(partial(drives, page, name), timeout_s=_LONG_S)
        if name == TEACHER:
            play.recordings.begin("eight")
        wait_until(partial(has_driven, page, name), timeout_s=_LONG_S)
    play.end_recording()
    teaching.learn("reservoir", ("eight",))
    tab.get_by_text("Record", exact=True).first.click()  # which folds it away
    wait_until(lambda: teaching.lesson is None or (teaching.lesson.share or 0.0) > 0.4, timeout_s=_LONG_S)
    tab.get_by_role("button", name="Cancel").scroll_into_view_if_needed()
    tab.locator(f"text={_ON}").first.scroll_into_view_if_needed()
    picture: bytes = tab.screenshot()
    teaching.cancel()
    return picture


def save_animation(frames: list[Image.Image], path: Path) -> None:
    """Write pictures as an animation, in so few colours that it is small."""
    first, *others = [frame.resize((420, 330)).quantize(64) for frame in frames]
    first.save(path, save_all=True, append_images=others, duration=_FRAME_MS, loop=0, optimize=True)
    if (size := path.stat().st_size) > MAX_BYTES:
        raise SystemExit(f"{path}: expected at most {MAX_BYTES} bytes, found {size}")


def main(folder: Path) -> None:
    """Make all pictures."""
    with TemporaryDirectory() as name:
        config = PlayConfig(controllers=(learned(Path(name)),), folder=Path(name))
        with playing(config) as play, served_page(play, Gate(), port=None) as page, chromium() as browser:
            thread = threading.Thread(target=page.run)
            thread.start()
            wait_until(lambda: play.link.controller == "learned")
            tab = browser.new_page(viewport={"width": _SIZE[0], "height": _SIZE[1]})
            tab.set_default_timeout(600_000)
            tab.goto(page.address)
            tab.locator(_NOTICE).first.click()
            wait_until(play.drive.errors)
            wait_until(lambda: play.drive.errors()[-1].time_ns - play.drive.errors()[0].time_ns > 15 * 10**9)
            (folder / "play.png").write_bytes(tab.screenshot())
            play.drive.hold()
            for place, centre in enumerate(play.robot.centres):
                play.drive.move_hand(place, centre)
            await_still(page)
            wait_until(lambda: np.abs(page.scene.handle_position(1) - play.robot.centres[1]).max() < 1e-3)
            save_animation(dragged(page, tab), folder / "play.gif")
            (folder / "teach.png").write_bytes(taught(page, tab))
            page.end()
            thread.join()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
