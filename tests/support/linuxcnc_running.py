"""The real LinuxCNC without a screen, in namespaces of its own, with a robot and a jig of the tests behind it."""

import ctypes
import json
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from identify.model.cell import Cell

T = TypeVar("T")
CONFIGURATION = Path(__file__).parent / "linuxcnc"
CLONE_NEWNET = 0x40000000
SENSOR_PERIOD = 0.0003  # [s]
DEPTH = 8.0  # [mm] behind a face where the sensor still feels it
RSH, BRIDGE = "socket://127.0.0.1:5007", "socket://127.0.0.1:5010"


def missing() -> str:
    """Why LinuxCNC cannot run here, or nothing."""
    if absent := [name for name in ("linuxcnc", "unshare", "nsenter") if shutil.which(name) is None]:
        return f"{', '.join(absent)} not installed (Debian: apt-get install linuxcnc-uspace)"
    if os.geteuid() != 0:
        return "a network namespace of its own needs root"
    tried = subprocess.run(["unshare", "--net", "--ipc", "--pid", "--fork", "--mount-proc", "true"], check=False)
    return "" if tried.returncode == 0 else "namespaces are not allowed here"


def needed() -> None:
    """Skip where LinuxCNC cannot run, but not in continuous integration."""
    if reason := missing():
        (pytest.fail if os.environ.get("CI") else pytest.skip)(f"LinuxCNC cannot run: {reason}")


class LinuxCNCRunning:
    """One LinuxCNC, from its start to its end; a context manager."""

    def __init__(self, folder: Path, cell: Cell, theta: np.ndarray) -> None:
        self.folder = folder
        shutil.copytree(CONFIGURATION, folder, dirs_exist_ok=True)
        (folder / "robot.tbl").touch()
        (folder / "truth.json").write_text(json.dumps(truth(cell, theta)), encoding="ascii")
        folder.chmod(0o777)  # LinuxCNC's realtime half gives up being root

    def __enter__(self) -> "LinuxCNCRunning":
        command = ["unshare", "--net", "--ipc", "--pid", "--fork", "--kill-child", "--mount-proc", "sh", "start.sh"]
        with (self.folder / "linuxcnc.log").open("wb") as log:
            self._process = subprocess.Popen(
                command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
            )
        self.namespace = Path(f"/proc/{self._process.pid}/ns/net")
        deadline = time.monotonic() + 60
        while not self._listens():
            if self._process.poll() is not None or time.monotonic() > deadline:
                self.__exit__()
                raise RuntimeError(f"LinuxCNC did not start:\n{self.said()}")
            time.sleep(0.05)
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)  # unshare takes everything inside along
        self._process.wait(30)

    def shut_down(self) -> int:
        """Tell LinuxCNC to end, as an operator would, and wait for it; its exit code."""
        self.inside(_say_shutdown)
        return self._process.wait(30)

    def restart(self) -> None:
        """Tell LinuxCNC to end, and have it started again behind that."""
        (self.folder / "restart").touch()
        self.inside(_say_shutdown)

    def begun(self, words: list[str]) -> subprocess.Popen[str]:
        """A command whose network is LinuxCNC's, under way."""
        return subprocess.Popen(
            ["nsenter", f"--net={self.namespace}", *words],
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def command(self, words: list[str]) -> tuple[int, str]:
        """Run such a command to its end; its exit code and what it said to stderr."""
        with self.begun(words) as process:
            said = process.communicate(timeout=300)[1]
        return process.returncode, said

    def inside(self, call: Callable[[], T]) -> T:
        """Call a function in a thread whose network is LinuxCNC's."""
        result: list[T] = []
        failure: list[BaseException] = []

        def work() -> None:
            try:
                enter(self.namespace)
                result.append(call())
            except BaseException as error:
                failure.append(error)

        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        if failure:
            raise failure[0]
        return result[0]

    def said(self) -> str:
        """What LinuxCNC and its parts have written."""
        return (self.folder / "linuxcnc.log").read_text(errors="replace")

    def felt(self) -> list[dict[str, list[float]]]:
        """Every time the sensor saw the contact close: joints [deg] before, when seen, after telling."""
        log = self.folder / "sensor.jsonl"
        return [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []

    def leftovers(self) -> list[str]:
        """Processes that still live in the namespace."""
        return [entry.name for entry in Path("/proc").glob("[0-9]*") if _network(entry) == self._identity]

    def _listens(self) -> bool:
        try:
            self._identity, own = self.namespace.readlink(), Path("/proc/self/ns/net").readlink()
            sockets = Path(f"/proc/{self._process.pid}/net/tcp").read_text().splitlines()
        except OSError:
            return False
        listening = {line.split()[1].split(":")[1] for line in sockets[1:] if line.split()[3] == "0A"}
        return self._identity != own and listening >= {f"{int(url.rpartition(':')[2]):04X}" for url in (RSH, BRIDGE)}


def _say_shutdown() -> None:
    with socket.create_connection(("127.0.0.1", 5007), 5) as line:
        line.sendall(b"hello EMC test 1\r\nset enable EMCTOO\r\nshutdown\r\n")
        line.settimeout(20)
        with suppress(ConnectionError):
            while line.recv(4096):
                pass


def _network(process: Path) -> Path | None:
    try:
        return (process / "ns" / "net").readlink()
    except OSError:
        return None


def enter(namespace: Path) -> None:
    """Move this thread into a network namespace."""
    libc = ctypes.CDLL(None, use_errno=True)
    with namespace.open() as file:
        if libc.setns(file.fileno(), CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f"setns {namespace}")


def truth(cell: Cell, theta: np.ndarray) -> dict[str, object]:
    """What the sensor is told: the parameters of the true robot and the drawing of the jig."""
    assert cell.jig is not None
    joints = len(cell.robot.joints)
    return {
        "base": theta[:6].tolist(),
        "links": theta[6 : 6 + 5 * joints].reshape(joints, 5).tolist(),
        "tool": theta[-6:].tolist(),
        "wire_radius": cell.wire.radius,
        "depth": DEPTH,
        "period_s": SENSOR_PERIOD,
        "faces": [{"origin": f.origin.tolist(), "u": f.u.tolist(), "v": f.v.tolist()} for f in cell.jig.faces],
        "log": "sensor.jsonl",
    }
