"""The table of makers: a fifth one is one more file and one more row."""

from collections.abc import Mapping
from pathlib import Path

from identify.model.files import InputError, Mistake
from identify.programs import abb, fanuc, kuka, yaskawa
from identify.programs.records import Maker

MAKERS: Mapping[str, Maker] = {
    ".ls": fanuc.MAKER,
    ".src": kuka.MAKER,
    ".dat": kuka.MAKER,
    ".mod": abb.MAKER,
    ".modx": abb.MAKER,
    ".prg": abb.MAKER,
    ".jbi": yaskawa.MAKER,
}


def maker_of(name: str) -> Maker:
    """Who writes files of this name; raises InputError where nobody does."""
    maker = MAKERS.get(Path(name).suffix.lower())
    if maker is None:
        formats = ", ".join(f"{suffix} ({maker.name})" for suffix, maker in MAKERS.items())
        other = (
            "for others, Universal Robots among them, correct the poses: touchcal compensate calibration.json poses.csv"
        )
        raise InputError(
            [Mistake(name, 0, f"not a program of a maker that is known; known endings: {formats}; {other}")]
        )
    return maker
