"""A cell with four planned touches, from which programs are written."""

from pathlib import Path

PLAN = Path(__file__).parents[1] / "probe" / "programs" / "plan.csv"
FEW = 4


def say_counting(folder, joints):
    """The cell file says how the controller counts."""
    (folder / "cell.yaml").write_text((folder / "cell.yaml").read_text() + f"joints: {joints}\n")
