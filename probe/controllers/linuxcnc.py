"""A LinuxCNC controller whose axes X Y Z A B C are the joints of the robot, through its stock linuxcncrsh.

Nothing of ours runs on the controller. What must outlive this program it keeps in named parameters: a number drawn when
it is first greeted (the boot: a restart forgets it), and those of the last command and of the last search. The line
that starts a search also spoils #5070, so that a search that never ran cannot pass off the latch of an earlier one.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
from jaxtyping import Float

from identify.model.robot import Robot
from probe.controllers.linuxcnc_machine import Machine
from probe.controllers.linuxcnc_mdi import AXES, LAST, SEARCH, SLOWEST, TRIPPED, Report, code_of, motion_words
from probe.controllers.linuxcncrsh import Shell
from probe.line.clock import Clock
from probe.line.controller import Contact, Latch, LinkLost, NoContact, Rebooted, Refused, State
from probe.line.messages import following
from probe.line.retry import T, patiently
from probe.line.transcript import Transport
from probe.line.watch import Watch

ARRIVED = 2 * SLOWEST  # [deg] or [mm]
PATIENCE = 4.0  # [s] before a controller that does not answer is given up
REOPENED = 0.3  # [s] between two attempts to open a port that is gone
CHATTER, NEAR = 5, 1.0  # times, and within how many [deg] or [mm] of where it began, a contact may stop a retract


class LinuxCNC:
    """The host's side of linuxcncrsh: motions in MDI, guarded by G38.3.

    LinuxCNC has no deadman: where the line breaks, a motion goes on until the line is back, and is stopped then. With
    `home`, `connect` homes the machine where it is not homed; without, nothing moves before the first move.
    """

    def __init__(self, transport: Transport, robot: Robot, clock: Clock, *, home: bool = False) -> None:
        self.name = f"LinuxCNC at {transport.url}"
        self.joints = len(robot.joints)
        self._prismatic = robot.prismatic
        self._unit = robot.joint_unit()
        self._clock = clock
        self._home = home
        self._shell = Shell(transport, clock)
        self._machine = Machine(self._shell, clock, self.joints)
        self._boot = ""
        self._last = 0
        self._counted = False  # whether both sides know the same last number

    def connect(self) -> None:
        """Take control, switch on and check; raises LinkLost, or Refused where the machine is not fit to touch."""
        self._shell.greet()
        self._compare()
        if self._machine.running():
            if self._shell.get("mode") != "MDI":
                raise Refused("BUSY", "a program runs on it; let it end, or abort it at its screen")
            self.stop()
        self._machine.switch_on()
        if self._home and self._machine.switched_on() and self._machine.unhomed():
            self._machine.home()
        self._adopt()
        self._refuse_rotation()

    @property
    def sequence(self) -> int:
        """The number that the next command will carry; it is asked for where it is not known."""
        if not self._counted:
            self._patiently(self._adopt)
        return following(self._last)

    def state(self) -> State:
        """How things stand now."""
        return self._patiently(self._state)

    def move(self, q: Float[np.ndarray, " joints"], rate: float) -> Float[np.ndarray, " joints"]:
        """Move straight to `q`; where the robot stands afterwards."""
        retracts, messages = self._patiently(self._machine.touching), list[str]()
        began = self._patiently(self._machine.commanded)
        for _ in range(CHATTER):
            messages, _ = self._motion("G1", q, rate)
            if self._patiently(lambda: self._at(q)):
                return self._patiently(self._standing)
            near = np.abs(self._patiently(self._machine.commanded) - began).max() < NEAR
            if not (retracts and near and code_of(messages, "") == "EARLY"):
                break
        touching = self._patiently(self._machine.touching)
        raise self._machine.refusal(messages, "EARLY" if touching and not retracts else _halted(messages))

    def search(self, q: Float[np.ndarray, " joints"], rate: float) -> Contact | NoContact:
        """Move straight towards `q` until the wire touches."""
        if self._patiently(self._machine.touching):
            raise Refused("ALREADY")
        messages, report = self._motion("G38.3", q, rate, f"{SEARCH}={self.sequence} {TRIPPED}=-1 ")
        stop = self._patiently(self._standing)
        if report is not None and report.tripped == 1:
            return Contact(self._inside(report.latched), stop, report.boot, report.search)
        if not self._patiently(lambda: self._at(q)):
            raise self._machine.refusal(messages, _halted(messages))
        return NoContact(stop)

    def latch(self) -> Latch | None:
        """The last latch of this boot."""
        report = self._patiently(self._adopt)
        if report.tripped != 1 or not report.search:
            return None
        return Latch(self._inside(report.latched), report.boot, report.search)

    def stop(self) -> None:
        """Stop the robot and return when it stands still."""
        self._counted = False
        self._patiently(self._shell.abort)
        self._patiently(self._machine.settle)

    def close(self) -> None:
        """Give the port back."""
        self._shell.transport.close()

    def _motion(
        self, code: str, q: Float[np.ndarray, " joints"], rate: float, parameters: str = ""
    ) -> tuple[list[str], Report | None]:
        """Have a motion made to its end: the messages that it caused, and what is known then.

        No report where nothing was to move, or a move (G1) arrived: its numbers are known. Raises Refused LOST where
        LinuxCNC never began it.
        """
        number = self.sequence
        start, target = self._patiently(self._ready), q / self._unit
        words = motion_words(start, target, float(np.abs(target - start).max() / np.degrees(rate)))
        if not words:
            return [], None
        self._counted = False
        from_contact = code == "G1" and self._patiently(self._machine.touching)
        watch = Watch(start, target, float(np.degrees(rate)), self._clock, from_contact=from_contact)
        try:
            self._machine.mdi(f"{LAST}={number} {parameters}G21 G90 G94 {code} {words}")
            self._machine.settle(watch)
        except LinkLost:
            self._patiently(self._shell.abort)  # nobody has watched it: it goes no further
            self._patiently(self._machine.settle)
        messages = self._patiently(self._shell.messages)
        if code == "G1" and self._patiently(lambda: self._at(q)):
            self._last, self._counted = number, True
            return messages, None
        report = self._patiently(self._adopt)  # heard after the motion, even where that began late
        self._patiently(self._machine.settle)
        if report.last != number:
            raise self._machine.refusal(messages, "LOST")
        return messages, report

    def _ready(self) -> Float[np.ndarray, " joints"]:
        """Where a motion would begin [deg or mm]; raises Refused where none may."""
        self._fit()
        if self._machine.running():
            raise Refused("BUSY", "let it end, or abort it at its screen")
        self._shell.messages()  # whatever was said before is not about this motion
        return self._machine.commanded()

    def _fit(self) -> None:
        """See that LinuxCNC would take a line of G-code; raises Refused, or Rebooted where it has lost its home."""
        machine = self._machine
        if unhomed := self._unhomed():
            joints = f"joint {', '.join(map(str, unhomed))}"
            raise Refused("UNHOMED", f"{joints}; home it at its own screen, nothing was moved")
        if not machine.switched_on():
            raise Refused("ESTOP", "or the machine is off; release it and switch on at its screen")
        if self._shell.get("mode") != "MDI" and not self._shell.set("mode mdi"):
            raise Refused("BUSY", "another program has taken control of linuxcncrsh")

    def _adopt(self) -> Report:
        """Ask LinuxCNC what it remembers, and count as it counts; raises Rebooted where it has forgotten."""
        self._fit()
        report = self._machine.report()
        before, self._boot = self._boot, report.boot
        if before not in ("", report.boot):
            raise self._rebooted()
        off = np.abs(report.at[: self.joints] - self._machine.commanded())
        if not off.max() < ARRIVED:
            raise Refused(
                "ROBOT",
                f"axis {AXES[int(off.argmax())]} is {off.max():.4f} away from its joint: each axis must be one joint "
                "(trivkins), in mm, without offsets (G49, G92.1, G54 at zero)",
            )
        self._last, self._counted = report.last, True
        return report

    def _state(self) -> State:
        machine, moving = self._machine, self._machine.moving()
        unhomed = self._unhomed()
        if not (self._counted or moving or unhomed) and machine.switched_on():
            with suppress(Refused):  # the state is told all the same
                self._adopt()
        return State(self._boot, moving, machine.touching(), self._standing(), self._last, not unhomed)

    def _unhomed(self) -> list[int]:
        """Joints that are not homed; raises Rebooted where they were."""
        unhomed = self._machine.unhomed()
        if unhomed and self._boot:
            self._boot, self._counted = "", False
            raise self._rebooted()
        return unhomed

    def _at(self, q: Float[np.ndarray, " joints"]) -> bool:
        return bool(np.abs(self._machine.commanded() - q / self._unit).max() < ARRIVED)

    def _standing(self) -> Float[np.ndarray, " joints"]:
        return self._inside(self._machine.standing())

    def _inside(self, values: Float[np.ndarray, " axes"]) -> Float[np.ndarray, " joints"]:
        return values[: self.joints] * self._unit

    def _compare(self) -> None:
        """See that the machine has the joints of the robot; raises Refused."""
        units = self._shell.get("joint_units").split()
        own_units = ["MM" if sliding else "DEG" for sliding in self._prismatic]
        if units != own_units or self.joints > len(AXES):
            raise Refused(
                "ROBOT", f"its joints count in {' '.join(units)}, expected {' '.join(own_units)}, at most six"
            )

    def _refuse_rotation(self) -> None:
        """A rotated work offset does not show until something moves."""
        system = int(self._machine.parameters("#5220")[0])
        rotation = self._machine.parameters(f"#{5210 + 20 * system}")[0]
        if rotation:
            raise Refused("ROBOT", f"its work offset is rotated by {rotation:g} deg; clear it: G10 L2 P{system} R0")

    def _patiently(self, call: Callable[[], T]) -> T:
        """Call, and where the line is gone open it anew and call again; raises LinkLost in the end."""
        return patiently(call, self._reopen, self._clock, PATIENCE)

    def _reopen(self) -> None:
        self._counted = False
        try:
            self._shell.reopen()
        except LinkLost:
            self._clock.sleep(REOPENED)

    def _rebooted(self) -> Rebooted:
        return Rebooted(
            f"the {self.name} has started anew, or lost its home: its position is not trusted any more; check that it "
            "is homed and shows where the robot stands, then go on with --resume --trust-position"
        )


def _halted(messages: Sequence[str]) -> str:
    """Why a motion ended on its way: LinuxCNC says nothing of an abort."""
    return "NOTREACHED" if messages else "STOPPED"
