#!/usr/bin/python3
"""HAL component: the wire of a robot whose true parameters are hidden, and the jig before it.

Runs with the system's Python, where LinuxCNC puts its modules, and shares no code with touchcal: the kinematics is
written anew, in scalars, from the base outwards. Pins: j0 ... jN in (degrees), contact out. `truth.json` says what is
true; every touch is noted in `sensor.jsonl` with the joints before it was seen, when, and after it was told.
"""

import json
import math
import sys
import time
from contextlib import suppress
from pathlib import Path


def turned(a, b, angle):
    """Two axes of a frame after a turn by `angle` about the third: a towards b."""
    c, s = math.cos(angle), math.sin(angle)
    return moved(moved([0.0] * 3, a, c), b, s), moved(moved([0.0] * 3, b, c), a, -s)


def moved(p, axis, length):
    return [p[0] + length * axis[0], p[1] + length * axis[1], p[2] + length * axis[2]]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class Cell:
    """A serial robot of turning joints, its wire, and the rectangles of a jig; millimetres and radians."""

    def __init__(self, truth):
        self.base, self.links, self.tool = truth["base"], truth["links"], truth["tool"]
        self.radius, self.depth = truth["wire_radius"], truth["depth"]
        self.faces = [self._face(face) for face in truth["faces"]]

    @staticmethod
    def _face(face):
        o, u, v = face["origin"], face["u"], face["v"]
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        size = math.sqrt(dot(n, n))
        return o, u, v, [c / size for c in n]

    def wire(self, q):
        """Tip and direction of the wire in the jig frame."""
        p, x, y, z = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
        p, x, y, z = self._placed(self.base, p, x, y, z)
        for (theta, d, a, alpha, beta), value in zip(self.links, q, strict=True):
            x, y = turned(x, y, theta + value)
            p = moved(moved(p, x, a), z, d)
            y, z = turned(y, z, alpha)
            z, x = turned(z, x, beta)
        p, x, y, z = self._placed(self.tool, p, x, y, z)
        return p, z

    @staticmethod
    def _placed(pose, p, x, y, z):
        p = moved(moved(moved(p, x, pose[0]), y, pose[1]), z, pose[2])
        x, y = turned(x, y, pose[3])
        z, x = turned(z, x, pose[4])
        y, z = turned(y, z, pose[5])
        return p, x, y, z

    def touches(self, q):
        """Whether the rim of the wire's flat end lies on, or not deeper than `depth` behind, any face."""
        p, a = self.wire(q)
        for o, u, v, n in self.faces:
            along, w = dot(n, a), moved(p, o, -1.0)
            gap = dot(n, w) - self.radius * math.sqrt(max(0.0, 1.0 - along * along))
            if -self.depth < gap <= 0.0:
                s, t = dot(w, u) / dot(u, u), dot(w, v) / dot(v, v)
                if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
                    return True
        return False


def serve(truth):
    import hal

    cell, component = Cell(truth), hal.component("touchsensor")
    names = [f"j{i}" for i in range(len(truth["links"]))]
    for name in names:
        component.newpin(name, hal.HAL_FLOAT, hal.HAL_IN)
    component.newpin("contact", hal.HAL_BIT, hal.HAL_OUT)
    component.ready()

    def read():
        """All joints of one servo period: a value may change while the next is read."""
        values = None
        while values != (values := [component[name] for name in names]):
            pass
        return values

    before, closed = read(), False
    with Path(truth["log"]).open("a", encoding="ascii") as log:
        while True:
            seen = read()
            touches = cell.touches([math.radians(value) for value in seen])
            component["contact"] = touches
            if touches and not closed:
                log.write(json.dumps({"before": before, "seen": seen, "told": read()}) + "\n")
                log.flush()
            before, closed = seen, touches
            time.sleep(truth["period_s"])


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        serve(json.loads(Path(sys.argv[1]).read_text(encoding="ascii")))
