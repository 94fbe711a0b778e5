"""What was executed and truly touched, as JSON lines, so that a judge in another process can read it."""

import json
from pathlib import Path

import numpy as np

from probe.virtual.robot import VirtualRobot


class Log:
    """A file with a line for each motion that ended and for each latch, in deg and mm, flushed at once."""

    def __init__(self, path: Path, robot: VirtualRobot) -> None:
        self._file = path.open("a", encoding="utf-8")
        self._robot = robot
        self._motions = self._touches = 0

    def write(self) -> None:
        """Write what has happened since the last time."""
        robot, unit = self._robot, self._robot.cell.robot.joint_unit()
        rows: list[dict[str, object]] = []
        for touch in robot.touches[self._touches :]:
            where = {"q": list(touch.q / unit), "arm": list(touch.arm / unit), "latch": list(touch.latch / unit)}
            rows.append({"touch": touch.surface, "time": touch.time, "latched": touch.latched, **where})
        for motion in robot.executed[self._motions :]:
            how = {"rate_deg_s": float(np.degrees(motion.rate)), "began": motion.began, "ended": motion.ended}
            where = {"q": list(motion.q / unit), "stop": list(motion.outcome.stop / unit)}
            rows.append({"motion": motion.kind, "outcome": motion.outcome.kind, **how, **where})
        self._motions, self._touches = len(robot.executed), len(robot.touches)
        if rows:
            self._file.write("".join(json.dumps(row) + "\n" for row in rows))
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()
