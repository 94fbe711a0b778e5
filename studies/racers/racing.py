"""A race: one problem, each racer in a process of its own with a limit of processor time, on one thread.

A racer that is no part of touchcal runs in the interpreter named by TOUCHCAL_PEERS_PYTHON, else in this one.
"""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
PEERS_PYTHON = "TOUCHCAL_PEERS_PYTHON"
PATIENCE = 30.0  # [s] of waiting for each second of processor time, on a machine that others use
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")
OURS = ("with_touchcal", "with_scipy")  # SciPy is a dependency of ours, so it is there


def race(racer: str, method: str, problem: Mapping[str, np.ndarray], seconds: float) -> dict[str, Any]:
    """What a method found, its processor time [s] (least mean of a block) and memory [MB]; or why not, as `result`."""
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / name for name in ("problem.npz", "answer.npz")]
        np.savez(files[0], **problem)  # type: ignore[arg-type]  # mypy takes it for allow_pickle
        command = [_python(racer), str(HERE / "child.py"), racer, method, *map(str, files), str(seconds)]
        environment = {**os.environ, **dict.fromkeys(THREADS, "1")}
        if racer == "with_touchcal":
            environment["PYTHONPATH"] = str(HERE.parents[1])
        try:
            run = subprocess.run(
                command, capture_output=True, text=True, env=environment, timeout=PATIENCE * seconds, check=False
            )
        except subprocess.TimeoutExpired:
            return {"result": f"not finished after {PATIENCE * seconds:g} s"}
        except OSError as error:
            return {"result": f"{command[0]} cannot be run: {error.strerror}"}
        if run.returncode:
            return {"result": _reason(run, seconds)}
        with np.load(files[1]) as file:
            return {name: value if value.ndim else value.item() for name, value in file.items()}


def _python(racer: str) -> str:
    return sys.executable if racer in OURS else os.environ.get(PEERS_PYTHON) or sys.executable


def _reason(run: "subprocess.CompletedProcess[str]", seconds: float) -> str:
    if run.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"not finished after {seconds:g} s of processor time"
    lines = run.stderr.strip().splitlines()
    return lines[-1][:200] if lines else f"exit code {run.returncode}"
