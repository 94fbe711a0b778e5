"""Faults on purpose: as many as were ordered, and the truth beside them."""

import numpy as np
import pytest

from oed.planning.plan import plan
from studies.simulator.faults import FAULTS, spoiled


@pytest.mark.parametrize("name", ["gross errors", "three wrong names"])
def test_a_fault_spoils_as_many_touches_as_it_says(name, arc_welder):
    fault, off = FAULTS[name], {face.name: 0.0 for face in arc_welder.jig.faces}
    design = plan(arc_welder, 30, strategy="even", rng=np.random.default_rng(1), count=600).plan

    touches, truth = spoiled(fault, arc_welder, design, arc_welder.theta, off, np.random.default_rng(2))

    tip = arc_welder.kinematics.tip(touches.q, arc_welder.theta)[0]
    away = np.abs((tip * touches.normal).sum(axis=1) - touches.offset) > 2.5
    faces = dict(zip(touches.ids, touches.face, strict=True))
    assert len(truth) == fault.names
    assert all(faces[i] != face for i, face in truth.items())
    assert away.sum() == pytest.approx(fault.gross * len(design) + fault.names, abs=2)
