"""Universal Robots e-Series and CB3: URScript that searches in a thread, and the lines it sends to a socket.

Sources: The URScript Programming Language, chapters on threads and scheduling: `run` starts a thread, `kill` ends
it at once, `sync()` uses up the rest of the control cycle (2 ms, 8 ms on CB3); movej with `t` moves all joints in
proportion in that time; `get_actual_joint_positions()` are the encoders of this cycle; `stopj` brakes. Programs
read for the form of the statements, at least two for each: `run move_thread()`, `kill` and `stopl` in programs of
four laboratories; `socket_open`, `socket_send_string`, `socket_send_byte(10, name)` and `socket_close` in a driver of
waypoints, a driver of a gripper and one of a printer; `sync()`, `popup`, `get_standard_digital_in` in tending programs;
and external_control.urscript of Universal_Robots_Client_Library (joints as whole numbers over a socket: `to_str` of a
real number has six digits only).
"""

import socket
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from identify.model.files import InputError, read_text
from identify.model.robot import Robot
from probe.programs.log import CLOSED, HELD, MISSED, OPENED, TOUCHED, Log, read_lines
from probe.programs.options import Options
from probe.programs.page import Instructions
from probe.programs.part import FAILURES, REST, STUCK, Part, joined
from probe.programs.routine import Joints

TOUCHES = 300  # in one script
UNITS = 10_000_000  # of a radian: whole numbers go over the line
ACCELERATION = 1.4  # [rad/s^2], the usual of movej
BRAKE = 2.0  # [rad/s^2]
SILENCE = 120.0  # [s] without a line, after which the robot is taken to be gone
END = b"end"

INSTRUCTIONS = Instructions(
    title="Universal Robots e-Series, CB3",
    prepare=(
        "The touch signal comes in as standard digital input {input}.",
        "The PC is {host} in the robot's network: --host and --port name it otherwise.",
    ),
    load=("Copy the .script files to a USB stick; in a new program put each into a Script node of its own (File).",),
    save=(
        "Start the PC first: touchcal import --listen {host}:{port} --plan plan.csv --maker ur -o touches.csv keeps "
        "what comes in touches.log, too, and can read that file again.",
    ),
    overwrites="nothing",
    slowly="in manual mode with the speed slider at 10 % and the enabling device in your hand, where there is one",
)


def capacity(options: Options) -> int:
    """Touches in one script; nothing but its size limits them."""
    return options.registers or TOUCHES


def write(part: Part) -> dict[str, str]:
    """The script of a part."""
    return {f"{part.name}.script": "\n".join([*_script(part), ""])}


def read(paths: Sequence[Path], robot: Robot, stamp: int) -> list[Log]:
    """Logs from files that hold what came over the socket; `stamp` is compared later."""

    def to_joints(values: Joints) -> Joints:
        return robot.from_controller(np.degrees(values / UNITS))

    return [read_lines(path, read_text(path).splitlines(), to_joints) for path in paths]


def listen(host: str, port: int, progress: Callable[[str], None], silence: float = SILENCE) -> str:
    """What a robot sends until it says `end` or hangs up; raises InputError where nothing comes."""
    try:
        server = socket.create_server((host, port))
    except OSError as error:
        raise InputError(f"--listen {port}: {error.strerror}; is another program listening there?") from None
    with server:
        progress(f"listening on port {server.getsockname()[1]}; start the program on the robot")
        connection, _ = server.accept()
        with connection:
            connection.settimeout(silence)
            received = b""
            try:
                while not received.rstrip().endswith(END) and (block := connection.recv(4096)):
                    received += block
            except TimeoutError:
                progress(f"nothing came for {silence:g} s; what came before is read")
    whole, _, _ = received.rpartition(b"\n")
    return whole.decode("ascii", "replace") + "\n"


def _joints(part: Part, q: Joints) -> str:
    return f"[{joined(np.radians(part.counts(q)), 7)}]"


def _script(part: Part) -> Iterator[str]:
    options = part.options
    yield from (f"# {remark}" for remark in part.remarks)
    if not options.rehearsal:
        yield from (*_functions(part), *_touch(part))
        stamp, first, count, speed = part.header
        yield f'if not socket_open("{options.host}", {options.port}, "tc"):'
        yield from (
            '  popup("no PC listens: start touchcal import --listen", title="touchcal", blocking=True)',
            "  halt",
            "end",
        )
        yield f'socket_send_line("touchcal {stamp} {first} {count} {speed}", "tc")'
    for routine in part.routines:
        yield f"# {routine.id} {routine.face}"
        for leg in routine.legs:
            yield f"movej({_joints(part, leg.q)}, a={ACCELERATION}, v={leg.speed:.4f})"
        if not options.rehearsal:
            yield f"tc_end = {_joints(part, routine.end)}"
            yield f"tc_seconds = {routine.seconds:.3f}"
            yield f"tc_touch({routine.number}, {_joints(part, routine.legs[-1].q)}, {routine.back.speed:.4f})"
    if not options.rehearsal:
        yield from ('socket_send_line("end", "tc")', 'socket_close("tc")')


def _signal(part: Part) -> str:
    return f"get_standard_digital_in({part.options.input or 0})"


def _functions(part: Part) -> list[str]:
    """The search in a thread, the wait for the input, and a line of the log."""
    signal = _signal(part)
    return f"""tc_end = [0, 0, 0, 0, 0, 0]
tc_seconds = 1.0
tc_done = False
tc_failed = 0
thread tc_search():
  movej(tc_end, a={ACCELERATION}, v=1.05, t=tc_seconds)
  tc_done = True
end
def tc_open():
  local waited = 0
  while {signal} and waited < {STUCK:g}:
    sleep(0.05)
    waited = waited + 0.05
  end
  return not {signal}
end
def tc_send(q):
  local i = 0
  while i < 6:
    socket_send_string(" ", "tc")
    socket_send_string(to_str(floor(q[i] * {UNITS} + 0.5)), "tc")
    i = i + 1
  end
  socket_send_byte(10, "tc")
end""".splitlines()


def _touch(part: Part) -> list[str]:
    """One touch: the input open, the search, the way back, the input open again; the code says how far it came."""
    signal = _signal(part)
    return f"""def tc_touch(number, approach, back):
  local code = {CLOSED}
  local q = approach
  local rest = approach
  if tc_open():
    code = {MISSED}
    tc_done = False
    local search = run tc_search()
    while code == {MISSED} and not tc_done:
      if {signal}:
        q = get_actual_joint_positions()
        kill search
        stopj({BRAKE})
        code = {OPENED}
      else:
        sync()
      end
    end
    if code == {OPENED}:
      sleep({REST:g})
      rest = get_actual_joint_positions()
      if {signal}:
        code = {TOUCHED}
      end
    else:
      join search
    end
    movej(approach, a={ACCELERATION}, v=back)
    sleep({part.options.wait:g})
    if not tc_open():
      code = {HELD}
    end
  end
  socket_send_string("t ", "tc")
  socket_send_string(to_str(number), "tc")
  socket_send_string(" ", "tc")
  socket_send_string(to_str(code), "tc")
  tc_send(q)
  socket_send_string("r ", "tc")
  socket_send_string(to_str(number), "tc")
  tc_send(rest)
  if code == {TOUCHED}:
    tc_failed = 0
  else:
    tc_failed = tc_failed + 1
  end
  if code == {CLOSED} or code == {HELD}:
    popup("the input is closed; free the wire", title="touchcal", blocking=True)
  end
  if tc_failed == {FAILURES}:
    tc_failed = 0
    popup("no contact; is the jig where the cell says?", title="touchcal", blocking=True)
  end
end""".splitlines()
