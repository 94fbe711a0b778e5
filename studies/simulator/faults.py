"""Faults on purpose: gross errors, wrong face names, a jig worse than stated; and whether a calibration names them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identify.model.calibration import Calibration
from identify.model.cell import Cell
from identify.model.touch import Plan, Touches
from studies.simulator.touching import touched

GROSS = 3.0, 10.0  # [mm] by which a gross touch ends early or late
NAMING = "names", "found", "proposed", "accused", "jig"


@dataclass(frozen=True)
class Fault:
    """What is wrong in the measurements of a robot."""

    gross: float = 0.0  # share of the touches that end early or late
    names: int = 0  # touches that bear the name of another face
    jig: float = 1.0  # times its stated tolerances that the jig is off

    @property
    def touches(self) -> bool:
        """Whether touches themselves are wrong."""
        return bool(self.gross or self.names)


FAULTS = {
    "none": Fault(),
    "gross errors": Fault(gross=0.2),
    "one wrong name": Fault(names=1),
    "three wrong names": Fault(names=3),
    "jig five times worse": Fault(jig=5.0),
}


def spoiled(
    fault: Fault,
    cell: Cell,
    plan: Plan,
    theta: Float[np.ndarray, " parameters"],
    off: Mapping[str, float],
    rng: np.random.Generator,
) -> tuple[Touches, dict[str, str]]:
    """Touches with a fault, and the true faces of those that bear a wrong name, by id."""
    some = rng.permutation(len(plan)) < fault.gross * len(plan)
    early = rng.uniform(*GROSS, len(plan)) * rng.choice([-1.0, 1.0], len(plan)) * some
    touches = touched(cell, plan, theta, off, rng, early)
    wrong = rng.choice(len(touches), fault.names, replace=False)
    face, normal, offset = list(touches.face), touches.normal.copy(), touches.offset.copy()
    for i in wrong:
        other = rng.choice([name for name in cell.the_jig.by_name if name != touches.face[i]])
        face[i], normal[i], offset[i] = other, cell.the_jig.by_name[other].normal, cell.the_jig.by_name[other].offset
    truth = {touches.ids[i]: touches.face[i] for i in wrong}
    return replace(touches, face=tuple(map(str, face)), normal=normal, offset=offset), truth


def naming(calibration: Calibration, truth: Mapping[str, str]) -> dict[str, float]:
    """NAMING: wrong names, those found, those with their right name, sound touches accused; a jig that is named."""
    sentences = {f.ids[0]: f.text for f in calibration.findings if f.kind == "wrong face"}
    doubtful = {name for f in calibration.findings if f.kind == "edge" for name in f.ids}
    hits = {name for name in truth if name in sentences or name in calibration.outliers or name in doubtful}
    proposed = sum(f"lies on '{face}'" in sentences.get(name, "") for name, face in truth.items())
    jig = any(f.kind == "jig" for f in calibration.findings)
    counts = len(truth), len(hits), proposed, len(sentences.keys() - truth.keys()), jig
    return dict(zip(NAMING, map(float, counts), strict=True))
