"""The judge of the hostile bench: what must hold in every schedule, by what the true world has written down.

It believes neither the driver nor its journal: touches are held against the crossings of the jig that the true tip
made, motions against the calls that asked for them. The journal is read for one thing only, the evidence in it.
"""

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from true_world import Moved, TrueWorld

from identify.model.cell import Cell
from identify.model.touch import HIT, Plan
from probe.line.controller import LinkLost, Rebooted, TouchError

SAME = 0.03  # [mm] from a touch to where the wire truly met the face: a servo step at 10 mm/s, and three decimals
ON_FACE = 0.01  # [mm]
BESIDE = np.radians(0.05)  # off the line of the plan, or of the way into contact
DEEP = 0.5  # [mm] that the tip may enter the jig
ASTRAY = 0.5  # [mm] off what was commanded
REST = np.radians(0.01)
CALLS = ("connect", "state", "move", "search", "latch", "stop")
MOTIONS = ("move", "search")
# [s] of any call beyond the motion that it was asked for: a line that is gone is given up after 5 s, twice in a stop
BOUND = {"connect": 20.0, "state": 15.0, "move": 30.0, "search": 30.0, "latch": 15.0, "stop": 20.0}


@dataclass
class Call:
    """A call of the controller."""

    name: str
    target: np.ndarray | None  # [rad]
    seconds: float  # that its motion should last
    began: float  # [s]
    ended: float = float("inf")
    heard: bool = False  # whether it came back knowing how things stand


@dataclass(frozen=True, eq=False)
class Crossing:
    """The true tip has met the jig in a search, and left it again."""

    q: np.ndarray  # [rad]
    began: float  # [s], the search
    left: float  # [s], the end of the first motion after which the tip was free; inf where none


@dataclass(eq=False)
class Oracle:
    """One schedule in the eyes of somebody who sees the robot."""

    world: TrueWorld
    cell: Cell
    plan: Plan
    device: Any
    calls: list[Call] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def watch(self, controller: Any) -> Any:
        """The controller, each of whose calls is written down."""
        for name in CALLS:
            setattr(controller, name, self._watched(name, getattr(controller, name)))
        return controller

    def _watched(self, name: str, method: Callable[..., Any]) -> Callable[..., Any]:
        def called(*arguments: Any) -> Any:
            clock = self.world.clock
            target = np.array(arguments[0]) if name in MOTIONS else None
            seconds = 0.0
            if target is not None:
                self.device.follow()
                seconds = float(np.abs(target - self.device.at()).max() / arguments[1])
            call = Call(name, target, seconds, clock.now())
            self.calls.append(call)
            try:
                result = method(*arguments)
                call.heard = True
                return result
            except TouchError as error:
                call.heard = not isinstance(error, LinkLost | Rebooted)
                raise
            finally:
                call.ended = clock.now()
                if name in (*MOTIONS, "stop") and call.heard:
                    self._stands(name)

        return called

    def _stands(self, name: str) -> None:
        self.device.follow()
        if self.device.moving:
            self.faults.append(f"the robot still moved when {name} came back")

    def expect_rest(self, seconds: float, why: str) -> None:
        """See that nothing begins to move, nor goes on."""
        here = self.device.at().copy()
        until = self.world.clock.now() + seconds
        while self.world.clock.now() < until:
            self.world.clock.sleep(0.5)
            self.device.follow()
        if np.abs(self.device.at() - here).max() > REST:
            self.faults.append(f"the robot moved after {why}")

    def violations(self, table: Path, journal: Path) -> Iterator[str]:
        """Everything that did not hold."""
        self.device.follow()
        yield from self.faults
        yield from self._bounds()
        yield from self._motions()
        if table.exists():
            rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
            if len({row["id"] for row in rows}) != len(rows):
                yield "a touch is doubled: two rows have the same id"
            yield from self._touches([row for row in rows if row["status"] == HIT], journal)

    def _bounds(self) -> Iterator[str]:
        for call in self.calls:
            if call.ended - call.began > BOUND[call.name] + call.seconds:
                yield f"{call.name} took {call.ended - call.began:.0f} s, its motion {call.seconds:.1f} s"

    # --- touches --------------------------------------------------------------------------------------------------

    def crossings(self) -> list[Crossing]:
        """Where searches that began in the open have met the jig."""
        found = []
        for i, one in enumerate(self.world.record):
            before, after = self.world.depth(np.stack([one.start, one.end]))
            if one.searching and before < -1e-6 <= after:
                at = self.world.first_contact(one.start, one.end)
                free = (m.ended for m in self.world.record[i + 1 :] if self.world.depth(m.end[None])[0] < -1e-6)
                q = one.end if at is None else one.start + at * (one.end - one.start)
                found.append(Crossing(q, one.began, next(free, float("inf"))))
        return found

    def _touches(self, rows: list[dict[str, str]], journal: Path) -> Iterator[str]:
        crossings, proven, taken = self.crossings(), evidenced(journal), list[Crossing]()
        for row in rows:
            q = np.radians([float(row[f"q{k + 1}_deg"]) for k in range(len(self.world.q))])
            at = float(row["time"].removesuffix("Z").rpartition(":")[2])
            away = [(float(np.linalg.norm(self._tip(one.q) - self._tip(q))), one) for one in crossings]
            near = [one for distance, one in away if distance <= SAME]
            if not near:
                least = min((distance for distance, _ in away), default=float("inf"))
                yield f"wrong touch: {row['id']} lies {least:.3f} mm from where the wire touched"
                continue
            yield from self._place(row, near[0].q)
            fresh = [one for one in near if one not in taken]
            if not fresh:
                yield f"a touch is doubled: {row['id']} is of a search that another row has"
            elif row["id"] not in proven or not any(self._open_around(one, at) for one in fresh):
                yield f"touch without evidence: {row['id']}"
            taken += fresh[:1]

    def _place(self, row: dict[str, str], q: np.ndarray) -> Iterator[str]:
        """Whether a crossing is on the face, and on the line, of the touch that claims it."""
        assert self.cell.jig is not None
        i = self.plan.ids.index(row["id"].partition("~")[0])
        face = self.cell.jig.by_name[row["face"]]
        off = abs(float(face.normal @ self._tip(q)) - face.offset)
        if row["face"] != self.plan.face[i] or off > ON_FACE:
            yield f"wrong touch: {row['id']} is {off:.3f} mm off face '{row['face']}'"
        if _beside(q, self.plan.approach[i], self.plan.q[i]) > BESIDE:
            yield f"wrong touch: {row['id']} is not on its own search"

    def _open_around(self, one: Crossing, written: float) -> bool:
        """Whether the input was open before the search and after the retract, before the row was written."""
        if self.world.is_forced(one.began) or one.left > written:
            return False
        return not all(self.world.is_forced(t) for t in np.linspace(one.left, written, 50))

    def _tip(self, q: np.ndarray) -> np.ndarray:
        return np.asarray(self.world.chain.tip(q[None])[0])

    # --- motions --------------------------------------------------------------------------------------------------

    def _motions(self) -> Iterator[str]:
        entry: Moved | None = None  # the motion that led into contact
        made: dict[int, int] = {}
        for one in self.world.record:
            call = next((i for i in reversed(range(len(self.calls))) if self._holds(i, one.began)), None)
            s = np.linspace(0, 1, 60)[:, None]
            depth = self.world.depth(one.start + s * (one.end - one.start))
            if not one.nowhere:
                yield from self._asked(one, call)
                if call is not None:
                    made[call] = made.get(call, 0) + 1
                yield from self._in_contact(one, depth, entry)
            if depth[-1] >= -1e-6 and (depth[0] < -1e-6 or entry is None):
                entry = one
        for i, count in made.items():
            if count > (5 if "linuxcnc" in type(self.device).__name__.lower() else 1):
                yield f"one {self.calls[i].name} made {count} motions"

    def _holds(self, number: int, time: float) -> bool:
        call = self.calls[number]
        return call.name in MOTIONS and call.began <= time <= call.ended

    def _asked(self, one: Moved, number: int | None) -> Iterator[str]:
        """Whether somebody asked for a motion, then, and to there."""
        call = None if number is None else self.calls[number]
        if call is None or call.target is None:
            yield "a motion began that nobody had asked for"
            return
        line = call.target - one.start
        share = np.clip((one.end - one.start) @ line / max(line @ line, 1e-18), 0, 1)
        off = np.linalg.norm(self._tip(one.end) - self._tip(one.start + share * line))
        if off > ASTRAY:
            yield f"the tip went {off:.2f} mm astray in a {call.name}"

    def _in_contact(self, one: Moved, depth: np.ndarray, entry: Moved | None) -> Iterator[str]:
        """Whether the tip stays out of the jig, and leaves it as it came."""
        if depth.max() > DEEP:
            yield f"the tip was {depth.max():.2f} mm inside the jig"
        if depth[0] < -1e-6:
            return
        if depth.max() > depth[0] + 0.02:
            yield f"a motion that began in contact led {depth.max() - depth[0]:.2f} mm deeper"
        if entry is not None and _beside(one.end, entry.start, entry.end) > BESIDE:
            yield "a motion that began in contact was not the retract"


def _beside(q: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """How far joints are off the straight line through two others [rad]."""
    line = b - a
    share = (q - a) @ line / max(line @ line, 1e-18)
    return float(np.abs(q - a - share * line).max())


def evidenced(journal: Path) -> set[str]:
    """The touches for which everything stands in the journal that DESIGN.md asks for."""
    seen: dict[str, bool] = {}
    proven: set[str] = set()
    for line in journal.read_text().splitlines():
        record = json.loads(line)
        if record["kind"] == "intent" and record["do"] == "search":
            seen = {place: closed for place, closed in seen.items() if place == "approach"}
        elif record["kind"] == "seen":
            seen[record["at"]] = record["closed"]
        elif record["kind"] == "result":
            if seen == {"approach": False, "contact": True, "retracted": False}:
                proven.add(record["id"])
            seen = {}
    return proven
