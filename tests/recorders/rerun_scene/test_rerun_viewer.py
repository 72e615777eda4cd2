"""A viewer is on this machine; what goes wrong with it, or with a recording's file, is one line and leaves nothing."""

import resource
import socket
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import rerun as rr
import rerun.blueprint as rrb
from episodes import write_episode
from processes import command, complaint, reenact

from recorders.errors import ConfigError, WireError
from recorders.rerun_scene.recording import Destination, open_recording
from recorders.rerun_scene.viewer import check_url, open_viewer
from recorders.wire.loopback import free_endpoint


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("log") / "circles.mcap", samples=64)


@pytest.fixture
def no_viewer() -> Iterator[int]:
    """Port of something that takes connections and answers none."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def refuse() -> None:
            while True:
                try:
                    server.accept()[0].close()
                except OSError:
                    return

        threading.Thread(target=refuse, daemon=True).start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)


@pytest.fixture(scope="module")
def whole(log: Path) -> Path:
    """Return a recording on a disk that has room for it."""
    run = reenact("view", log, "--save", "whole.rrd", cwd=log.parent)
    assert run.returncode == 0, run.stderr
    return log.with_name("whole.rrd")


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST"])
def test_a_viewer_of_this_machine_is_taken(no_viewer: int, host: str) -> None:
    assert check_url(f"rerun+http://{host}:{no_viewer}/proxy") == f"rerun+http://{host.lower()}:{no_viewer}/proxy"


@pytest.mark.parametrize("host", ["127.3.2.1", "[::1]"])
def test_a_viewer_is_sought_wherever_on_loopback(host: str) -> None:
    port = free_endpoint().rpartition(":")[2]
    with pytest.raises(WireError, match=r"expected a viewer at .*, found none"):
        check_url(f"rerun+http://{host}:{port}/proxy")


@pytest.mark.parametrize(
    "host",
    ["192.0.2.2", "0.0.0.0", "[::]", "[2001:db8::1]", "[::ffff:192.0.2.2]", "[::1%25eth0]", "localhost.example.org"],
)
def test_a_viewer_elsewhere_is_not_even_tried(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[object] = []
    monkeypatch.setattr(socket, "create_connection", tried.append)
    with pytest.raises(ConfigError, match=r"expected a viewer on this machine, at localhost, 127\.0\.0\.1 or \[::1\]"):
        check_url(f"rerun+http://{host}:9876/proxy")
    assert not tried


@pytest.mark.parametrize(
    "url",
    [
        "",
        "http://127.0.0.1:9876/proxy",
        "rerun+http://127.0.0.1/proxy",
        "rerun+http://127.0.0.1:0/proxy",
        "rerun+http://127.0.0.1:99999/proxy",
        "rerun+http://127.0.0.1:9876/other",
        "rerun+http://127.0.0.1:9876/proxy?to=elsewhere",
        "rerun+http://user@127.0.0.1:9876/proxy",
        "rerun+http://example.org\\@127.0.0.1:9876/proxy",
        "rerun+http://127.0.0.1\n:9876/proxy",
        "rerun+http://[::1:9876/proxy",
    ],
)
def test_what_two_readers_of_urls_may_take_for_different_places_is_refused(url: str) -> None:
    with pytest.raises(ConfigError, match="expected the URL of a viewer") as raised:
        check_url(url)
    assert "\n" not in str(raised.value)


def test_without_a_display_a_way_out_is_named_that_every_verb_has(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ConfigError, match=r"no display; `reenact view LOG\|CONTROLLER --save FILE\.rrd` writes"):
        open_viewer()


def test_a_viewer_that_is_none_is_one_line(log: Path, no_viewer: int, tmp_path: Path) -> None:
    run = reenact("view", log, "--viewer", f"rerun+http://127.0.0.1:{no_viewer}/proxy", cwd=tmp_path)
    assert f"cannot write the recording to rerun+http://127.0.0.1:{no_viewer}/proxy: " in complaint(run)


@pytest.mark.parametrize("share", [0.3, 0.98])
def test_a_disk_that_fills_up_is_one_line_and_leaves_no_half_recording(
    log: Path, whole: Path, tmp_path: Path, share: float
) -> None:
    """As on a full disk, writing fails after so much of the recording, also when little but its end is missing."""
    most = int(share * whole.stat().st_size)
    run = subprocess.run(
        command("view", log, "--save", "half.rrd"),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )
    assert complaint(run) == "reenact: cannot write the recording 'half.rrd': File too large"
    assert list(tmp_path.iterdir()) == []


def test_a_recording_that_is_not_finished_leaves_no_file(tmp_path: Path) -> None:
    def end_early() -> None:
        destination = Destination(tmp_path / "x.rrd")
        with open_recording(destination, recording_id=None, title="x", blueprint=rrb.Blueprint()) as recording:
            recording.log("x", rr.Scalars(1.0))
            assert (tmp_path / "x.rrd").exists()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        end_early()
    assert list(tmp_path.iterdir()) == []
