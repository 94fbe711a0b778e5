"""Plans: what they promise, and what they say when they cannot."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.files import InputError
from oed.planning import plan


def test_a_plan_touches_the_planes_of_its_faces(arc_welder):
    result = plan(arc_welder, n=30)

    wire, q = arc_welder.wire, result.plan.q
    tip, R = arc_welder.kinematics.tip(q, arc_welder.theta)
    faces = [arc_welder.jig.by_name[name] for name in result.plan.face]
    height = [f.normal @ t - f.offset for f, t in zip(faces, tip, strict=True)]
    lean = [np.sqrt(1 - (f.normal @ r[:, 2]) ** 2) for f, r in zip(faces, R, strict=True)]
    assert height == pytest.approx(wire.radius * np.array(lean), abs=1e-3)  # [mm], a micrometre


def test_a_cell_without_a_jig_gets_one_sentence(arc_welder):
    with pytest.raises(InputError, match="no jig to touch"):
        plan(replace(arc_welder, jig=None), n=30)
