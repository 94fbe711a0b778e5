"""Lines of sight from a tracker to the target at the tip: within reach and view, seen from the front, and clear."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import Cell, Device
from identify.model.frames import transform
from probe.motion.clearance import WIRE, Clearance
from probe.motion.distances import Points, segment_segment

IN_SIGHT = -1
REASONS = (
    "are nearer or further than the tracker measures",
    "are beside, above or below where it looks",
    "turn the target away",
    "hide it behind arm, tool or obstacles",
)
"""Why a target is not seen, in the order in which it is looked at."""


def sight(
    cell: Cell,
    kind: str,
    clearance: Clearance,
    q: Float[np.ndarray, "postures joints"],
    placement: Sequence[str] | None,
    tool: Sequence[str] | None,
) -> Int[np.ndarray, " postures"]:
    """Place in REASONS of why the tracker does not see the target of each posture, or IN_SIGHT.

    A tracker measures in the frame of its placement and stands at `Device.stand` there. A cell that does not say where
    has no lines of sight to look at. The arm is that of its capsules, which contain its links: a few targets that are
    seen past a link count as hidden.
    """
    device, out = cell.device(kind), np.full(len(q), IN_SIGHT)
    if device.stand is None or not len(q):
        return out
    theta = np.tile(clearance.theta, (len(q), 1))
    for i, name in enumerate(tool or ()):
        theta[i, -6:] = cell.tools[name] if name else theta[i, -6:]
    tip, R = cell.kinematics.tip(q, theta)
    frames = _stands(cell, clearance.theta, placement, len(q))
    stand = frames[:, :3, :3] @ device.stand + frames[:, :3, 3]
    ray = np.einsum("mji,mj->mi", frames[:, :3, :3], tip - stand)  # in the frame in which the tracker measures
    length = np.linalg.norm(ray, axis=1)
    faults = (
        (length < device.range[0]) | (length > device.range[1]),
        ~_within(device, ray),
        _turned_away(device, R, tip - stand),
        _hidden(clearance, q, tip.T, stand.T),
    )
    for reason in reversed(range(len(faults))):
        out[faults[reason]] = reason
    return out


def unseen_note(device: Device, kind: str, reasons: Int[np.ndarray, " postures"]) -> str:
    """How many postures the tracker does not see, and why; empty where it sees all of them."""
    numbers = [int((reasons == k).sum()) for k in range(len(REASONS))]
    if device.stand is None or not sum(numbers):
        return ""
    why = ", ".join(f"{number} {reason}" for number, reason in zip(numbers, REASONS, strict=True) if number)
    place = ", ".join(f"{x:g}" for x in device.stand)
    return (
        f"{sum(numbers)} of {len(reasons)} postures for a {kind} are out of sight of the tracker at ({place}) mm: {why}"
    )


def _stands(
    cell: Cell, theta: Float[np.ndarray, " parameters"], placement: Sequence[str] | None, count: int
) -> Float[np.ndarray, "postures 4 4"]:
    """jig_T_stand of each posture: the frame in which it is measured, seen from that of the jig."""
    frames, jig_T_base = np.tile(np.eye(4), (count, 1, 1)), transform(theta[:6])
    for i, name in enumerate(placement or ()):
        further = cell.placements[name] if name else None
        if further is not None:
            frames[i] = jig_T_base @ np.linalg.inv(transform(further))
    return frames


def _within(device: Device, ray: Float[np.ndarray, "postures 3"]) -> np.ndarray:
    """Whether rays lie within azimuth and elevation."""
    x, y, z = ray.T
    (left, right), (low, high) = device.azimuth, device.elevation
    elevation = np.arctan2(z, np.hypot(x, y))
    beside = (np.arctan2(y, x) - left) % (2 * np.pi) > right - left
    return np.asarray(~beside & (elevation >= low) & (elevation <= high))


def _turned_away(
    device: Device, R: Float[np.ndarray, "postures 3 3"], ray: Float[np.ndarray, "postures 3"]
) -> np.ndarray:
    """Whether targets look elsewhere than to the tracker."""
    if device.target_axis is None:
        return np.zeros(len(ray), dtype=bool)
    axis = R @ (device.target_axis / np.linalg.norm(device.target_axis))
    cosine = -(axis * ray).sum(axis=1) / np.maximum(np.linalg.norm(ray, axis=1), 1e-9)
    return np.asarray(cosine < np.cos(device.acceptance))


def _hidden(clearance: Clearance, q: Float[np.ndarray, "postures joints"], tip: Points, stand: Points) -> np.ndarray:
    """Whether arm, tool or obstacles stand in lines of sight; a target that sits in a capsule is not hidden by it."""
    hidden = clearance.segments_near(tip, stand, np.full(len(q), WIRE))
    for start, end, radius in zip(
        *(ends.transpose(1, 0, 2) for ends in clearance.ends(q)), clearance.radius, strict=True
    ):
        outside = segment_segment(tip, tip, start, end) > radius
        hidden |= outside & (segment_segment(tip, stand, start, end) < radius)
    return hidden
