"""A controller file holds everything, the same controller gives the same bytes, and no file can hurt."""

import io
import json
import os
import stat
import zipfile

import numpy as np
import pytest

from pipeline.learner import npz
from pipeline.learner.controller import Controller, check_writable
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.learner.state import state_digest
from pipeline.seeding import uniforms
from recorders.errors import ControllerError

CONFIG = LearnerConfig(reservoir=30, outputs=8, epochs=2)
JOINTS = ("hip_yaw", "elbow")


def trained():
    learner = Learner(CONFIG, input_centre=np.arange(6.0), output_centre=np.arange(8.0))
    numbers = uniforms(0, "data", count=140).reshape(10, 14)
    learner.begin_epoch(1)
    learner.step(numbers[:, :6], numbers[:, 6:], learning=True)
    return learner


def controller(learner=None, **changes):
    parts = {"joints": JOINTS, "robot_toml": "name = 'übung'\n", "robot_urdf": "<robot/>", "pending": np.arange(6.0)}
    parts |= {"provenance": {"logs": ["a.mcap"], "seed": 0}}
    return Controller.from_learner(learner or trained(), **{**parts, **changes})


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "controller.npz"
    controller().save(path)
    return path


def test_everything_comes_back(path):
    saved, loaded = controller(), Controller.load(path)
    for name in ("config", "joints", "robot_toml", "robot_urdf", "provenance", "digest"):
        assert getattr(loaded, name) == getattr(saved, name)
    for name in ("input_centre", "output_centre", "pending"):
        assert np.array_equal(getattr(loaded, name), getattr(saved, name))
    assert loaded.digest == state_digest(trained().state(), np.arange(6.0))


def test_a_loaded_learner_goes_on_to_the_bit(path):
    learner, loaded = trained(), Controller.load(path).learner()
    assert isinstance(loaded, Learner)
    assert loaded.epoch == learner.epoch == 1
    u, d = uniforms(1, "u", count=60).reshape(10, 6), uniforms(1, "d", count=80).reshape(10, 8)
    assert np.array_equal(loaded.step(u, d, learning=True), learner.step(u, d, learning=True))
    assert state_digest(loaded.state()) == state_digest(learner.state())


def test_equal_controllers_give_equal_bytes_and_nothing_else_is_left(path, tmp_path):
    Controller.load(path).save(tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["again.npz", "controller.npz"]


def test_numpy_opens_the_file(path):
    with np.load(path, allow_pickle=False) as file:
        assert json.loads(file["header"].tobytes())["joints"] == list(JOINTS)
        assert np.array_equal(file["a"], trained().state()["a"])


def test_a_controller_cannot_be_changed(path):
    loaded = Controller.load(path)
    with pytest.raises(ValueError, match="read-only"):
        loaded.state["a"][0] = 0.0
    with pytest.raises(AttributeError):
        loaded.joints = ()  # type: ignore[misc]


@pytest.mark.parametrize(
    "changes",
    [
        {"joints": ("hip_yaw",)},
        {"joints": ("elbow", "elbow")},
        {"pending": np.zeros(5)},
        {"pending": np.full(6, np.nan)},
    ],
)
def test_parts_that_do_not_fit_are_refused(changes):
    with pytest.raises(ControllerError, match="expected"):
        controller(**changes)


def test_a_provenance_that_is_not_json_is_refused(tmp_path):
    for provenance in ({"path": object()}, {"value": float("nan")}):
        with pytest.raises(ControllerError, match="provenance"):
            controller(provenance=provenance).save(tmp_path / "x.npz")
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_one_error(tmp_path):
    (tmp_path / "directory").mkdir()
    (tmp_path / "file").touch()
    os.mkfifo(tmp_path / "pipe")
    places = [
        tmp_path / "missing" / "x.npz",
        tmp_path / "file" / "x.npz",
        tmp_path / "directory",
        tmp_path / "pipe",
        tmp_path / ("x" * 300),
    ]
    for path in (*places, f"{tmp_path}/nul\0", ".", "..", "/", ""):
        for write in (check_writable, controller().save):
            with pytest.raises(ControllerError, match="cannot write controller") as caught:
                write(path)
            assert "\n" not in str(caught.value)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["directory", "file", "pipe"]
    assert not (tmp_path / "pipe").is_file()


def test_a_place_is_checked_without_a_trace(tmp_path):
    controller().save(tmp_path / "old.npz")
    (tmp_path / "empty.npz").touch()
    before = (tmp_path / "old.npz").read_bytes()
    for name in ("new.npz", "old.npz", "empty.npz"):
        check_writable(tmp_path / name)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["empty.npz", "old.npz"]
    assert (tmp_path / "old.npz").read_bytes() == before


def test_a_file_that_is_no_controller_is_not_to_be_replaced(tmp_path):
    controller().save(tmp_path / "cut.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / "cut.npz").read_bytes()[:-100])
    (tmp_path / "text").write_text("somebody's work")
    np.savez(tmp_path / "arrays.npz", weights=np.zeros(3))
    for name in ("cut.npz", "text", "arrays.npz"):
        with pytest.raises(ControllerError, match=f"{name}: there is a file that is no controller, which stays"):
            check_writable(tmp_path / name)


def test_a_saved_controller_has_the_permissions_of_any_new_file(tmp_path):
    before = os.umask(0o027)
    try:
        controller().save(tmp_path / "x.npz")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "x.npz").stat().st_mode) == 0o640


# malformed files


def refuse(path, match):
    with pytest.raises(ControllerError, match=match) as caught:
        Controller.load(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def rewrite(path, change):
    members = npz.unpack(path.read_bytes())
    change(members)
    path.write_bytes(npz.pack(members))


def rewrite_header(path, **changes):
    def change(members):
        header = json.loads(members["header"]) | changes
        members["header"] = json.dumps({key: value for key, value in header.items() if value is not ...})

    rewrite(path, change)


def test_a_missing_file_and_a_directory(tmp_path):
    refuse(tmp_path / "none.npz", "no such file")
    refuse(tmp_path, "expected a controller, found a directory")


@pytest.mark.parametrize("data", [b"", b"not a zip", b"PK\x03\x04" + bytes(100), b"PK\x05\x06" + bytes(18)])
def test_what_is_not_an_npz(tmp_path, data):
    (tmp_path / "x.npz").write_bytes(data)
    refuse(tmp_path / "x.npz", "cannot use controller")


def test_an_npz_of_someone_else(tmp_path):
    np.savez(tmp_path / "x.npz", a=np.zeros(3))
    refuse(tmp_path / "x.npz", "header")


def test_pickled_arrays_are_never_unpickled(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "harmed"), "w"))

    np.savez(tmp_path / "x.npz", header=np.array([Bomb()], dtype=object))
    refuse(tmp_path / "x.npz", "float64 or text")
    assert not (tmp_path / "harmed").exists()


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"format": "other"}, "reenact-controller"),
        ({"version": 2}, "format version 1, found 2"),
        ({"version": True}, "format version 1, found true"),
        ({"config": {"reservoir": 10**9}}, "reservoir"),
        ({"config": {"reservoir": 200_000, "outputs": 8}}, "20000000 connections"),
        ({"config": {"reservoir": 5000, "outputs": 8}}, "shape"),
        ({"config": {"colour": 1}}, "unknown learner setting colour"),
        ({"config": {**CONFIG.to_dict(), "seed": 1}}, "connections digest"),
        ({"config": []}, "config"),
        ({"joints": ["elbow", 3]}, "strings"),
        ({"joints": ["elbow"]}, "different joints"),
        ({"robot_urdf": ...}, "robot_urdf"),
        ({"state_digest": "00"}, "state digest"),
        ({"provenance": "me"}, "provenance"),
    ],
)
def test_a_header_that_does_not_fit(path, changes, match):
    rewrite_header(path, **changes)
    refuse(path, match)


@pytest.mark.parametrize("text", ["", "{", "[]", "[" * 100_000, '{"format": NaN}'])
def test_a_header_that_is_not_json(path, text):
    rewrite(path, lambda members: members.update(header=text))
    refuse(path, "header")


@pytest.mark.parametrize("name", ["a", "x", "input_output_weights", "pending", "input_centre", "epoch"])
def test_an_array_that_is_missing_misshapen_not_finite_or_changed(path, name):
    values = npz.unpack(path.read_bytes())[name]
    for wrong in (np.zeros(3), np.zeros((2, 2)), np.full_like(values, np.nan), "text"):
        rewrite(path, lambda members, wrong=wrong: members.update({name: wrong}))
        refuse(path, "expected|digest")
    rewrite(path, lambda members: members.pop(name))
    refuse(path, "expected")


def test_one_changed_bit_of_the_state_is_seen(path):
    def change(members):
        members["a"].view(np.uint64)[0] ^= np.uint64(1)

    rewrite(path, change)
    refuse(path, "state digest")


def test_a_file_that_claims_more_than_it_holds(tmp_path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**60, 2**60)})
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("header.npy", header.getvalue())
    refuse(tmp_path / "x.npz", "found 0 bytes")


def test_a_small_file_that_unpacks_to_a_large_one(tmp_path, monkeypatch):
    monkeypatch.setattr(npz, "MAX_BYTES", 2**22)
    with zipfile.ZipFile(tmp_path / "x.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(3):
            archive.writestr(f"{number}.npy", bytes(2**21))
    assert (tmp_path / "x.npz").stat().st_size < 2**14
    refuse(tmp_path / "x.npz", "at most 4194304 bytes unpacked")


MAGIC = b"\x93NUMPY\x01\x00"
GOOD = b"{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }\n"


@pytest.mark.parametrize(
    "header",
    [
        b"{'descr': (",
        b"if 1:\n  a\n b\n",
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (2" + b"0" * 40 + b",), }\n",
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (-2,), }\n",
        b"{'descr': '<f8', 'fortran_order': True, 'shape': (2,), }\n",
        b"{'descr': '|O', 'fortran_order': False, 'shape': (2,), }\n",
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (" + b"1, " * 70 + b"2), }\n",
        b"(" * 900,
        b" " * 5000 + GOOD,
        b"",
    ],
)
def test_a_member_whose_header_numpy_would_not_write(header):
    assert npz.unpack(zipped(GOOD))["a"].tolist() == [0.0, 0.0]
    with pytest.raises(ControllerError, match="expected") as caught:
        npz.unpack(zipped(header))
    assert "\n" not in str(caught.value)


def zipped(header, packing=zipfile.ZIP_STORED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", packing) as archive:
        archive.writestr("a.npy", MAGIC + len(header).to_bytes(2, "little") + header + bytes(16))
    return file.getvalue()


@pytest.mark.parametrize("packing", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_a_packing_that_numpy_does_not_use_is_not_unpacked(packing):
    assert npz.unpack(zipped(GOOD, zipfile.ZIP_DEFLATED))["a"].tolist() == [0.0, 0.0]
    with pytest.raises(ControllerError, match="stored or deflated"):
        npz.unpack(zipped(GOOD, packing))


@pytest.mark.parametrize("packing", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_a_flipped_bit_at_every_byte_is_one_error_or_no_difference(packing):
    """All of a small file, every byte with one of its bits and then with another one."""
    data = zipped(GOOD, packing)
    for place in range(len(data)):
        for bit in (place % 8, (5 * place + 3) % 8):
            wrong = bytearray(data)
            wrong[place] ^= 1 << bit
            try:
                members = npz.unpack(bytes(wrong))
            except ControllerError as error:
                assert "\n" not in str(error)  # noqa: PT017
            else:
                assert all(values.tolist() == [0.0, 0.0] for values in members.values())


def test_flipped_bits_all_over_a_controller(tmp_path):
    config = LearnerConfig(reservoir=4, inputs=1, outputs=2, epochs=1)
    learner = Learner(config, input_centre=[0.0], output_centre=[0.0] * 2)
    Controller.from_learner(learner, joints=("elbow",), robot_toml="", robot_urdf="").save(tmp_path / "x.npz")
    data, digest = (tmp_path / "x.npz").read_bytes(), learner_digest(tmp_path / "x.npz")
    for place in range(0, len(data), 4):
        wrong = bytearray(data)
        wrong[place] ^= 1 << (place // 4 % 8)
        (tmp_path / "x.npz").write_bytes(wrong)
        try:
            assert learner_digest(tmp_path / "x.npz") == digest
        except ControllerError as error:
            assert "\n" not in str(error)  # noqa: PT017


def learner_digest(path):
    return state_digest(Controller.load(path).state)


@pytest.mark.parametrize("damage", ["cut", "flip"])
def test_damage_anywhere_is_one_error_or_no_difference(path, damage):
    """A fixed-seed sample of the places; zip fields that nobody reads may change unseen, values may not."""
    data, digest = path.read_bytes(), Controller.load(path).digest
    for place in (uniforms(0, damage, count=150) * len(data)).astype(int).tolist():
        wrong = bytearray(data[:place] if damage == "cut" else data)
        if damage == "flip":
            wrong[place] ^= 1 << (place % 8)
        path.write_bytes(wrong)
        try:
            loaded = Controller.load(path)
        except ControllerError as error:
            assert "\n" not in str(error)  # noqa: PT017
        else:
            assert damage == "flip"
            assert loaded.digest == digest
