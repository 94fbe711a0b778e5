"""What the robot must not hit: solids, and faces that no solid bears."""

import numpy as np

from identify.model.io.description import read_jig
from probe.motion.obstacles import obstacles, owners

RAMP = """
name: ramp
faces:
- {name: top, origin_mm: [0, 100, 50], u_mm: [100, 0, 0], v_mm: [0, 50, 0], tolerance_mm: 0.02}
- {name: ramp, origin_mm: [0, 0, 0], u_mm: [100, 0, 0], v_mm: [0, 100, 50], tolerance_mm: 0.02}
boxes:
- {lower_mm: [0, 100, 0], upper_mm: [100, 150, 50]}
- {lower_mm: [0, 50, 0], upper_mm: [100, 100, 20]}
"""


def test_a_leaning_face_over_a_staircase_of_boxes_is_a_solid_of_its_own(tmp_path):
    (tmp_path / "jig.yaml").write_text(RAMP)
    jig = read_jig(tmp_path / "jig.yaml")

    solids = obstacles(jig)

    assert [solid.name for solid in solids] == ["box 1", "box 2", "face ramp"]
    assert owners(jig, solids).tolist() == [[True, False, False], [False, False, True]]
    inside, above = np.array([[50.0], [30.0], [5.0]]), np.array([[50.0], [20.0], [60.0]])  # under the ramp, in no box
    assert min(solid.segment(above, inside)[0] for solid in solids) == 0
    assert min(solid.segment(above, inside)[0] for solid in solids[:2]) > 15
