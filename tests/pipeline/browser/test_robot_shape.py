"""The robot on the page: every shape of its URDF where the joints put it, of triangles that enclose the body."""

import coal
import numpy as np
import pytest
from viser import BatchedMeshHandle

from pipeline.browser.page.gate import Gate
from pipeline.browser.page.robot_shape import RobotShape
from pipeline.browser.page.server import page_server
from pipeline.browser.page.solids import SOLIDS
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics

ASIMO = load_robot("asimo")
BODIES = {
    "Box": (coal.Box(2.0, 4.0, 6.0), (1.0, 2.0, 3.0), 8.0),
    "Cylinder": (coal.Cylinder(0.5, 4.0), (0.5, 0.5, 2.0), 2.0 * np.pi),
    "Sphere": (coal.Sphere(0.5), (0.5, 0.5, 0.5), 4.0 / 3.0 * np.pi),
}


@pytest.mark.parametrize("kind", list(SOLIDS))
def test_triangles_look_outwards_and_enclose_the_body(kind: str) -> None:
    solid, (body, half_extents, volume) = SOLIDS[kind], BODIES[kind]
    corners = solid.vertices[solid.faces]
    outwards = np.einsum("fi,fi->f", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2])
    assert outwards.min() > -1e-12
    assert outwards.sum() / 6.0 == pytest.approx(volume, rel=0.05)
    assert solid.size(body) == pytest.approx(half_extents)


def test_all_shapes_of_a_robot_are_there_and_move_with_its_joints() -> None:
    with page_server(Gate(), port=None, label="robot") as server:
        shape = RobotShape(server, ASIMO)
        batches = [node for node in server.scene._handle_from_node_name.values() if isinstance(node, BatchedMeshHandle)]
        assert sum(len(batch.batched_positions) for batch in batches) == ASIMO.urdf_text.count("<visual>")
        assert all(len(batch.batched_scales) == len(batch.batched_colors) for batch in batches)
        before = np.concatenate([batch.batched_positions for batch in batches])
        q = ASIMO.comfort.copy()
        place = ASIMO.joints.index("hip_height")
        q[place] = ASIMO.upper[place]
        shape.show(q)
        moved = np.concatenate([batch.batched_positions for batch in batches]) - before
        raised = q[place] - ASIMO.comfort[place]
        legs = np.abs(moved).max(axis=1) < 1e-6
        assert 0 < legs.sum() < len(moved)
        assert moved[~legs] == pytest.approx(np.tile([0.0, 0.0, raised], ((~legs).sum(), 1)), abs=1e-6)
        assert (Kinematics(ASIMO).hands(q) - Kinematics(ASIMO).hands(ASIMO.comfort))[0] == pytest.approx([0, 0, raised])
