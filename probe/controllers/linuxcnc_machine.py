"""What LinuxCNC can be asked and told through linuxcncrsh, in its own units: degrees, or millimetres."""

import secrets
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from probe.controllers.linuxcnc_mdi import BOOT, LAST, REPORTED, SEARCH, TRIPPED, Report, code_of, read_report
from probe.controllers.linuxcncrsh import Shell
from probe.line.clock import Clock
from probe.line.controller import LinkLost, Refused, TouchError
from probe.line.watch import Watch

POLL = 0.02  # [s]
SETTLED = 0.02  # [s] without a change of position: the task of LinuxCNC looks every 1 to 10 ms
STALLED = 2.5  # [s] between two looks at whether a motion goes on: a feed hold, or an override of 0
REPEAT = 1.0  # [s] before a question to the parameters is asked again: another screen may have taken the answer
GIVE_UP = 5.0  # [s] before such questions are given up
HOMING = 180.0  # [s]


class Machine:
    """LinuxCNC, looked at and told what to do; every method may raise LinkLost."""

    def __init__(self, shell: Shell, clock: Clock, joints: int) -> None:
        self.shell = shell
        self.joints = joints
        self._clock = clock
        self._rested: Float[np.ndarray, " joints"] | None = None  # where it was last seen at rest, nothing told since

    def commanded(self) -> Float[np.ndarray, " joints"]:
        """Where LinuxCNC wants the axes to be: free of the encoders' trembling."""
        return np.array(self.shell.numbers("abs_cmd_pos")[: self.joints])

    def standing(self) -> Float[np.ndarray, " joints"]:
        """What the encoders say."""
        return np.array(self.shell.numbers("joint_pos")[: self.joints])

    def touching(self) -> bool:
        """Whether the touch input is closed."""
        return self.shell.get("probe_value") == "1"

    def switched_on(self) -> bool:
        """Whether the emergency stop is released and the machine on."""
        return self.shell.get("estop") == "OFF" and self.shell.get("machine") == "ON"

    def running(self) -> bool:
        """Whether a line of G-code is being executed."""
        return self.shell.get("program_status") != "IDLE"

    def unhomed(self) -> list[int]:
        """Joints that are not homed, counted from 1."""
        words = self.shell.get("joint_homed").split()[: self.joints]
        return [i for i, word in enumerate(words, 1) if word != "YES"]

    def moving(self) -> bool:
        """Whether anything moves: looks twice, a moment apart, and once where it rested before and was told nothing."""
        before, at = self._rested, self.commanded()
        if before is None or not np.array_equal(before, at):
            before = at
            self._clock.sleep(SETTLED)
            at = self.commanded()
        moving = self.running() or not np.array_equal(before, at)
        self._rested = None if moving else at
        return moving

    def settle(self, watch: Watch | None = None) -> None:
        """Wait until nothing moves; raises Refused where a motion does not go on, or strays, once it is stopped."""
        if not self._rests(watch):
            self.shell.abort()
            if not self._rests():
                raise LinkLost(f"LinuxCNC at {self.shell.transport.url} does not obey an abort; stop the robot")
            raise Refused("NOTREACHED", "the motion did not go on; was it a feed hold, or an override of 0?")

    def switch_on(self) -> None:
        """Reset the emergency stop and switch the machine on, where that is possible."""
        for what, state in (("estop", "OFF"), ("machine", "ON")):
            if self.shell.get(what) != state:
                self.shell.set(f"{what} {state}")

    def home(self) -> None:
        """Home every joint; raises Refused where that does not end."""
        self._rested = None
        self.shell.set("mode manual")
        if not self.shell.set("home -1"):  # other versions home joint by joint only
            for joint in self.unhomed():
                self.shell.set(f"home {joint - 1}")
        deadline = self._clock.now() + HOMING
        while self.unhomed():
            if self._clock.now() > deadline:
                raise self.refusal(self.shell.messages(), "UNHOMED")
            self._clock.sleep(SETTLED)

    def mdi(self, line: str) -> None:
        """Have a line of G-code begun; raises Refused where it is not taken."""
        self._rested = None
        if not self.shell.set(f"mdi {line}"):
            raise self.refusal([*self.shell.messages(), "or another program has taken control of linuxcncrsh"], "BUSY")

    def report(self) -> Report:
        """What the parameters say; a LinuxCNC that nobody has greeted yet is given its boot first."""
        report = read_report(self.parameters(REPORTED))
        if not report.boot:
            self.mdi(f"{BOOT}={secrets.randbelow(0xFFFF) + 1} {LAST}=0 {SEARCH}=0 {TRIPPED}=-1")
            report = read_report(self.parameters(REPORTED))
        return report

    def parameters(self, names: str) -> list[float]:
        """Values of parameters, shown as a message with a tag of ours; NaN where one does not exist."""
        deadline = self._clock.now() + GIVE_UP
        while self._clock.now() < deadline:
            tag = f"touchcal {secrets.token_hex(3)}"
            self.mdi(f"(DEBUG,{tag} {names})")
            deadline_to_answer = self._clock.now() + REPEAT
            while self._clock.now() < deadline_to_answer:
                text = self.shell.get("operator_display")
                if text.startswith(tag):
                    return [float("nan") if "#" in word else float(word) for word in text.split()[2:]]
                self._clock.sleep(POLL)
        raise TouchError(
            "LinuxCNC does not show its parameters; does another screen take its messages? close that screen"
        )

    def refusal(self, messages: Sequence[str], otherwise: str) -> Refused:
        """Why LinuxCNC did not do what it was asked, in its own words."""
        code = "ESTOP" if self.shell.get("estop") == "ON" else code_of(messages, otherwise)
        return Refused(code, "; ".join(messages))

    def _rests(self, watch: Watch | None = None) -> bool:
        """Wait until nothing moves; False where a line of G-code runs on, but nothing moves."""
        looked, at = self._clock.now(), self.commanded()
        while self.running() or self.moving():
            self._clock.sleep(POLL)
            if watch and (astray := watch.objection(self.standing(), self.touching())):
                self.shell.abort()
                self._rests()
                raise Refused("ASTRAY", astray)
            if self._clock.now() - looked > STALLED:
                if np.array_equal(at, at := self.commanded()):
                    return False
                looked = self._clock.now()
        return True
