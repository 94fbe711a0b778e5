"""Run one method of one racer on one problem, again and again, and write down what it found, its time and its memory.

python child.py RACER METHOD PROBLEM.npz ANSWER.npz SECONDS
"""

import resource
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

REPEATS, LEAST = 9, 1.0  # blocks of runs, or seconds of them, after the first
BLOCK = 0.1  # [s] that a block takes at least; its mean is one time
MEMORY = 8 << 30  # [bytes]: a racer may not take the machine down
SHARE = 0.1  # of the time allowed that goes into repeats


def main(racer: str, method: str, problem: str, answer: str, seconds: str) -> None:
    """Write the answer; exits by SIGXCPU where the processor time allowed is over."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(float(seconds)), int(float(seconds)) + 5))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    try:
        solve = import_module(racer).METHODS[method]
    except ImportError as error:
        np.savez(answer, result=f"cannot be imported: {error}")
        return
    with np.load(problem) as file:
        data = dict(file)
    first, answers = timed(solve, data)
    again: list[float] = []
    spent = 0.0
    while (len(again) < REPEATS or spent < LEAST) and spent + first < SHARE * float(seconds):
        count, block = 0, 0.0
        while block < BLOCK:  # the clock ticks: a run of milliseconds may seem to take none
            block, count = block + timed(solve, data)[0], count + 1
        again.append(block / count)
        spent += block
    share = answers.pop("share", 1.0)  # of a batch
    times = {"first_s": first * share, "cpu_s": min(again or [first]) * share}
    np.savez(answer, runs=1 + len(again), peak_mb=peak_mb(), **times, **answers)  # type: ignore[arg-type]


def peak_mb() -> float:
    """Most memory that this program had in use; getrusage counts that of the process that started it as well."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def timed(solve: Any, data: dict[str, np.ndarray]) -> tuple[float, dict[str, np.ndarray]]:
    """Processor time of this process [s], and what was found."""
    begin = time.process_time()
    answer = solve(data)
    return time.process_time() - begin, answer


if __name__ == "__main__":
    main(*sys.argv[1:])
