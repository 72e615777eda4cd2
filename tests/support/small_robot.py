"""A made-up robot as others might bring it: a trunk, two arms of four joints, and much that nobody needs here."""

from pathlib import Path

ARM = ("shoulder", "swing", "elbow", "wrist")
JOINTS = ("rise", "turn", *(f"{side}_{name}" for side in ("l", "r") for name in ARM))

INERTIA = '<inertia ixx="0.002" ixy="0" ixz="0.0001" iyy="0.0025" iyz="0" izz="0.001"/>'
MESH = '<geometry><mesh filename="package://nowhere/{0}.dae"/></geometry>'


def link(name: str, *, mass: float, centre: str) -> str:
    inertial = f'<inertial><origin xyz="{centre}" rpy="0.1 0 0"/><mass value="{mass}"/>{INERTIA}</inertial>'
    shape = MESH.format(name)
    return f'<link name="{name}">{inertial}<visual>{shape}</visual><collision>{shape}</collision></link>'


def joint(
    name: str, parent: str, child: str, *, xyz: str, axis: str = "0 1 0", limits: str = "", kind: str = ""
) -> str:
    ends = f'<origin xyz="{xyz}" rpy="0 0 0"/><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
    kind = kind or "revolute"
    return f'<joint name="{name}" type="{kind}">{ends}{limits}</joint>'


def limited(lower: float, upper: float) -> str:
    return f'<limit lower="{lower}" upper="{upper}" effort="60" velocity="5"/>'


def arm(side: str, sign: int) -> str:
    """An arm that hangs down: upper arm 0.25 m, forearm 0.2 m, and a hand aside of the wrist's axis."""
    links = [link(f"{side}_{name}_link", mass=0.8, centre="0 0 -0.08") for name in ARM]
    joints = [
        joint(
            f"{side}_shoulder", "chest", f"{side}_shoulder_link", xyz=f"0 {0.2 * sign} 0.3", limits=limited(-2.5, 1.0)
        ),
        joint(
            f"{side}_swing",
            f"{side}_shoulder_link",
            f"{side}_swing_link",
            xyz="0 0 0",
            axis="1 0 0",
            limits=limited(-0.8, 0.8),
        ),
        joint(f"{side}_elbow", f"{side}_swing_link", f"{side}_elbow_link", xyz="0 0 -0.25", limits=limited(-2.4, 0.1)),
        joint(f"{side}_wrist", f"{side}_elbow_link", f"{side}_wrist_link", xyz="0 0 -0.2", limits=limited(-1.0, 1.0)),
        joint(f"{side}_grip", f"{side}_wrist_link", f"{side}_finger", xyz="0 0 -0.08", limits=limited(0.2, 1.0)),
    ]
    return "".join([*links, *joints, link(f"{side}_finger", mass=0.1, centre="0 0 -0.03")])


MODEL = "".join(
    [
        '<robot name="theirs"><gazebo reference="chest"><mu1>any</mu1></gazebo>',
        '<link name="world"/>',
        link("pelvis", mass=4.0, centre="0 0 0"),
        joint("anchor", "world", "pelvis", xyz="0 0 0", kind="fixed"),
        link("chest", mass=6.0, centre="0 0 0.15"),
        joint("turn", "pelvis", "chest", xyz="0 0 0.1", axis="0 0 1", limits=limited(-1.0, 1.0)),
        link("fan", mass=0.2, centre="0.01 0 0"),
        joint("spin", "chest", "fan", xyz="-0.1 0 0.2", axis="1 0 0", kind="continuous"),
        link("leg", mass=3.0, centre="0 0 -0.3"),
        joint("hip", "pelvis", "leg", xyz="0 0 0", limits=limited(-1.0, 1.0)),
        link("foot", mass=1.0, centre="0.05 0 0"),
        joint("ankle", "leg", "foot", xyz="0 0 -0.6", limits=limited(-1.0, 1.0)),
        arm("l", 1),
        arm("r", -1),
        "</robot>",
    ]
)
"""Their model looks along x; it stands with its pelvis at the origin."""

IMPORT = """
drop = ["hip"]

[source]
urdf = "model.urdf"

[base]
xyz = [0.0, 0.0, 0.7]
rpy = [0.0, 0.0, 1.5707963267948966]

[frozen]
l_grip = 0.5
r_grip = 0.5
spin = 0.7

[[virtual]]
name = "rise"
type = "prismatic"
axis = [0.0, 0.0, 1.0]
lower = -0.1
upper = 0.1
effort = 1000.0
velocity = 0.5

[[frames]]
name = "l_palm"
parent = "l_finger"
xyz = [0.02, 0.0, -0.04]

[[frames]]
name = "r_palm"
parent = "r_finger"
xyz = [0.02, 0.0, -0.04]
"""

_COMFORT = {"shoulder": -0.4, "elbow": -1.2, "turn": 0.0}
_ROWS = "".join(
    f'    {{ name = "{name}", weight = {0.2 if name in ("rise", "turn") else 1.0}, '
    f"comfort = {_COMFORT.get(name.partition('_')[2] or name, 0.0)} }},\n"
    for name in JOINTS
)
CONFIG = f"""
name = "small"
joints = [
{_ROWS}]

[[hands]]
name = "left"
link = "l_palm"
controls = "position"
centre = [-0.2, 0.34, 0.9]
box = [0.1, 0.05, 0.1]

[[hands]]
name = "right"
link = "r_palm"
controls = "position"
centre = [0.2, 0.34, 0.9]
box = [0.1, 0.05, 0.1]

[gaze]
joint = "turn"
frame = "chest"

# It looks along the world's y: its left is at -x.
[pattern]
lateral = [-1.0, 0.0, 0.0]
up = [0.0, 0.0, 1.0]
"""


def write_robot(folder: Path) -> Path:
    """Write the robot as a folder for `--robot`: their model, and what is made of it."""
    folder.mkdir()
    (folder / "model.urdf").write_text(MODEL)
    (folder / "import.toml").write_text(IMPORT)
    (folder / "robot.toml").write_text(CONFIG)
    return folder
