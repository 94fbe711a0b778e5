"""Frames and tools of positions: from the table, from the program itself, or the defaults."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.frames import inverse
from identify.programs.records import Record, Ref
from identify.programs.setup import Setup


@dataclass(frozen=True, eq=False)
class Place:
    """Where a position counts from, and what stands there."""

    base_T_frame: Float[np.ndarray, "4 4"]
    tip_T_tool: Float[np.ndarray, "4 4"]  # from the cell's tip to the program's, both as the controller has them
    why: str = ""  # why it is not known
    assumptions: tuple[str, ...] = ()  # what was assumed

    def base_T_tip(self, frame_T_tool: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
        """The cell's tip in the base, of a position in the program."""
        return self.base_T_frame @ frame_T_tool @ inverse(self.tip_T_tool)

    def frame_T_tool(self, base_T_tip: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
        """The inverse of `base_T_tip`."""
        return inverse(self.base_T_frame) @ base_T_tip @ self.tip_T_tool


def places(records: Sequence[Record], setup: Setup, flange_T_tip: Float[np.ndarray, "4 4"]) -> list[Place]:
    """Where each position counts from.

    A tool other than the cell's is taken to be another point of the same torch: where the cell's tip was found beside
    its nominal place, the other point is too.
    """
    return [_place(record, setup, flange_T_tip) for record in records]


def _place(record: Record, setup: Setup, flange_T_tip: Float[np.ndarray, "4 4"]) -> Place:
    frame, why_frame, assumed_frame = _look_up(record.frame, setup.frames, "frame", "the robot's base")
    tool, why_tool, assumed_tool = _look_up(record.tool, setup.tools, "tool", "the cell's tool")
    tip_T_tool = np.eye(4) if tool is None else inverse(flange_T_tip) @ tool
    return Place(
        np.eye(4) if frame is None else frame, tip_T_tool, why_frame or why_tool, (*assumed_frame, *assumed_tool)
    )


def _look_up(
    ref: Ref, table: Mapping[str, Float[np.ndarray, "4 4"]], what: str, default: str
) -> tuple[Float[np.ndarray, "4 4"] | None, str, tuple[str, ...]]:
    """A frame or tool, why it is not known, and what is assumed; none stands for the default."""
    frames = {name.lower(): T for name, T in table.items()}
    if ref.name and ref.name.lower() in frames:
        return frames[ref.name.lower()], "", ()
    if ref.T is not None or not ref.name:
        return ref.T, "", ()
    if table:
        return None, f"{what}: {what} {ref.name} is not in the table", ()
    return None, "", (f"{what} {ref.name} is taken for {default}; say otherwise in a table (--setup)",)
