"""A robot's description opens no file and takes no machine down, whichever way it comes in."""

import os
from pathlib import Path

import pytest
import rerun as rr
from episodes import write_episode
from opened import watched
from peak_memory import peak_memory_mb
from rerun.urdf import UrdfTree
from small_robot import MODEL, write_robot

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.robot.config import RobotConfig, load_robot, parse_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.simulation.simulation import Simulation
from pipeline.training.trainer import train
from pipeline.views.robot_drawing import RobotDrawing
from pipeline.views.view import view_controller, view_log
from recorders.errors import RobotError
from recorders.rerun_scene.recording import Destination
from recorders.rerun_scene.robot import RobotModel
from replay.sources.schedule import Schedule

ASIMO = load_robot("asimo")
SECRET = "solid secret\nendsolid secret\n"
NAMES = (
    "{}/secret.stl",
    "file://{}/secret.stl",
    "file:{}/secret.stl",
    "package://pkg/secret.stl",
    "model://pkg/secret.stl",
    "../../../../../../../../../..{}/secret.stl",
    "{}/link.stl",
    "{}/secret.stl?x",
)


@pytest.fixture
def secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "pkg"
    folder.mkdir()
    (folder / "secret.stl").write_text(SECRET)
    (folder / "link.stl").symlink_to("secret.stl")
    for variable in ("ROS_PACKAGE_PATH", "GAZEBO_MODEL_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.setenv(variable, str(tmp_path))
    return folder / "secret.stl"


def meshes(folder: Path) -> str:
    """Links' shapes that name the file in every way."""
    names = [name.format(folder) for name in NAMES]
    shapes = "".join(
        f'<{kind}><geometry><mesh filename="{name}"/></geometry></{kind}>'
        for kind in ("collision", "visual")
        for name in names
    )
    textures = "".join(
        f'<visual><geometry><box size="1 1 1"/></geometry>'
        f'<material name="t{place}"><texture filename="{name}"/></material></visual>'
        for place, name in enumerate(names)
    )
    return shapes + textures


def show(robot: RobotConfig) -> None:
    RobotModel.load(robot.plain_urdf, robot.joints).send_static(rr.RecordingStream("test"))


def hostile_urdf(folder: Path) -> str:
    texture = f'<material name="paint"><texture filename="{folder}/secret.stl"/></material>'
    text = ASIMO.urdf_text.replace('<link name="pelvis">', f'{texture}<link name="pelvis">{meshes(folder)}', 1)
    assert text.count("secret.stl") > 20
    return text


def test_the_watch_sees_what_opens_a_mesh(secret: Path) -> None:
    mesh = f'<visual><geometry><mesh filename="{secret}"/></geometry></visual>'
    (path := secret.with_name("robot.urdf")).write_text(f'<robot name="r"><link name="a">{mesh}</link></robot>')
    with watched(secret) as opened:
        UrdfTree.from_file_path(path).log_urdf_to_recording(rr.RecordingStream("test"))
        assert opened()


def test_no_library_opens_a_file_that_a_robot_names(secret: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with watched(secret) as opened:
        robot = parse_robot(ASIMO.toml_text, hostile_urdf(secret.parent))
        Kinematics(robot)
        Simulation(robot).advance(robot.comfort, 5_000_000)
        RobotDrawing(robot)
        show(robot)
        assert not opened()
    assert "secret" not in robot.plain_urdf
    assert capfd.readouterr() == ("", "")


def test_a_log_and_a_controller_show_nothing_but_themselves(secret: Path, tmp_path: Path) -> None:
    attachments = {"robot.urdf": hostile_urdf(secret.parent).encode(), "robot.toml": ASIMO.toml_text.encode()}
    log = write_episode(tmp_path / "log.mcap", samples=12, attachments=attachments)
    controller = tmp_path / "controller.npz"
    with watched(secret) as opened:
        train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=1)).controller().save(controller)
        view_log(log, Destination(tmp_path / "log.rrd"))
        view_controller(controller, Destination(tmp_path / "controller.rrd"))
        assert not opened()
    for recording in ("log.rrd", "controller.rrd"):
        assert b"secret" not in (tmp_path / recording).read_bytes()


def test_a_folder_and_an_import_open_their_own_files_alone(secret: Path, tmp_path: Path) -> None:
    plain, made = tmp_path / "plain", write_robot(tmp_path / "made")
    plain.mkdir()
    (plain / "robot.urdf").write_text(hostile_urdf(secret.parent))
    (plain / "robot.toml").write_text(ASIMO.toml_text)
    (made / "model.urdf").write_text(
        MODEL.replace('<link name="chest">', f'<link name="chest">{meshes(secret.parent)}')
    )
    with watched(secret) as opened:
        for folder in (plain, made):
            robot = load_robot(folder)
            show(robot)
        assert not opened()


def test_pipes_and_devices_are_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    shapes = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        for name in (tmp_path / "pipe.stl", "/dev/zero", "/proc/self/environ", "/etc/passwd")
    )
    robot = parse_robot(
        ASIMO.toml_text, ASIMO.urdf_text.replace('<link name="pelvis">', f'<link name="pelvis">{shapes}')
    )
    show(robot)


@pytest.mark.parametrize("tag", ['<mesh filename="/etc/passwd"/>', '<texture filename="/etc/passwd"/>'])
def test_the_viewer_takes_no_text_that_names_a_file(tag: str) -> None:
    text = ASIMO.plain_urdf.replace("</robot>", f"{tag}</robot>")
    with pytest.raises(RobotError, match="expected shapes that need no file, found <"):
        RobotModel.load(text, ASIMO.joints)


JOINT = '<joint name="x{0}" type="fixed"><parent link="{1}"/><child link="x{0}"/></joint><link name="x{0}"/>'


def in_a_row(count: int) -> str:
    return "".join(JOINT.format(place, f"x{place - 1}" if place else "head") for place in range(count))


def side_by_side(count: int) -> str:
    return "".join(JOINT.format(place, "head") for place in range(count))


def in_a_ring(count: int) -> str:
    return "".join(JOINT.format(place, f"x{(place + 1) % count}") for place in range(count))


ENDLESS = {
    "199 in a row": (in_a_row(199), "at most 200 joints in a row, found 20"),
    "8,000 in a row": (in_a_row(8_000), "at most 1000 joints, found 8018"),
    "24,000 in a row": (in_a_row(24_000), "at most 1000 joints, found 24018"),
    "24,000 side by side": (side_by_side(24_000), "at most 1000 joints, found 24018"),
    "900 in a ring": (in_a_ring(900), "hang on one another in a ring"),
    "links of one name": (side_by_side(900) + '<link name="x5"/>', "link x5 of the URDF is given more than once"),
    "a link with two parents": (
        side_by_side(2) + '<joint name="y" type="fixed"><parent link="x0"/><child link="x1"/></joint>',
        "link x1 of the URDF: expected it to be the child of one joint, found 2",
    ),
    "loose links": ("".join(f'<link name="x{place}"/>' for place in range(60_000)), "one link that is no child"),
    "shapes": (
        side_by_side(1)
        + '<link name="y">'
        + '<visual><geometry><sphere radius="1"/></geometry></visual>' * 3_000
        + '</link><joint name="y" type="fixed"><parent link="x0"/><child link="y"/></joint>',
        "at most 2000 shapes of its links, found 30",
    ),
}


@pytest.mark.parametrize("name", ENDLESS)
def test_a_robot_without_end_is_one_line(name: str) -> None:
    more, message = ENDLESS[name]
    with pytest.raises(RobotError, match=message) as caught:
        parse_robot(ASIMO.toml_text, ASIMO.urdf_text.replace("</robot>", f"{more}</robot>"))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1200


@pytest.mark.parametrize(
    "number",
    ["1" * 3_000_000, "1" * 3_000_000 + "x", "0." + "1" * 3_000_000, "0 " * 1_500_000],
    ids=["digits", "no number", "fraction", "many"],
)
def test_a_number_without_end_is_one_line(number: str) -> None:
    """And is read in linear time: a pattern that goes back and forth would take days."""
    text = ASIMO.urdf_text.replace('xyz="0 0 0.28"', f'xyz="0 0 {number}"')
    with pytest.raises(RobotError, match=r"link 'legs' of .* <origin xyz=...> to hold 3 finite numbers"):
        parse_robot(ASIMO.toml_text, text)


def test_what_nothing_refers_to_is_passed_over() -> None:
    materials = "".join(f'<material name="m{place}"><color rgba="0 0 0 1"/></material>' for place in range(5_000))
    motors = '<transmission><joint name="hip_yaw"/></transmission>' * 5_000
    robot = parse_robot(ASIMO.toml_text, ASIMO.urdf_text.replace("</robot>", f"{materials}{motors}</robot>"))
    assert robot.plain_urdf == ASIMO.plain_urdf


def test_no_such_robot_takes_much_memory() -> None:
    read = (
        "import sys; from pipeline.robot.config import load_robot, parse_robot\n"
        "from recorders.errors import RobotError\n"
        "asimo = load_robot('asimo')\n"
        "for more in sys.stdin.read().split('\\0'):\n"
        "    try: parse_robot(asimo.toml_text, asimo.urdf_text.replace('</robot>', more + '</robot>'))\n"
        "    except RobotError: pass\n"
        "    else: sys.exit('accepted')"
    )
    attributes = "<link " + " ".join(f'a{place:x}=""' for place in range(400_000)) + "/>"
    texts = [*(more for more, _ in ENDLESS.values()), attributes, "<a/>" * 900_000, "<a>" * 900_000]
    assert peak_memory_mb(read, text="\0".join(texts)) < 300


def test_a_log_with_such_a_robot_takes_little_memory_to_refuse(secret: Path, tmp_path: Path) -> None:
    endless = ASIMO.urdf_text.replace("</robot>", f"{in_a_row(24_000)}</robot>")
    robots = {
        "endless.mcap": (endless, ASIMO.toml_text),
        "deep.mcap": (ASIMO.urdf_text, ".".join("a" * 16_000) + " = 1"),
        "files.mcap": (hostile_urdf(secret.parent).replace(str(secret), "/dev/zero"), ASIMO.toml_text),
    }
    for name, (urdf, toml) in robots.items():
        attachments = {"robot.urdf": urdf.encode(), "robot.toml": toml.encode()}
        write_episode(tmp_path / name, samples=12, attachments=attachments)
    view = (
        "from pipeline.cli.app import main\n"
        f"for name, status in (('endless', 2), ('deep', 2), ('files', 0)):\n"
        f"    try: main(['view', f'{tmp_path}/{{name}}.mcap', '--save', f'{tmp_path}/{{name}}.rrd'])\n"
        "    except SystemExit as ended: assert ended.code == status, (name, ended.code)"
    )
    assert peak_memory_mb(view) < 300


def test_a_robot_within_the_bounds_is_simulated_and_shown(tmp_path: Path) -> None:
    """As many joints, and as many in a row, as are let through."""
    for more in (in_a_row(180), side_by_side(980)):
        robot = parse_robot(ASIMO.toml_text, ASIMO.urdf_text.replace("</robot>", f"{more}</robot>"))
        simulation = Simulation(robot)
        simulation.advance(robot.comfort, 5_000_000)
        show(robot)
