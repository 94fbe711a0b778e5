"""Thousands of hostile schedules: `python -m tests.probe.hostile --schedules 10000 [--backend line] [--seed 17]`.

With `--seed` one schedule is replayed alone; exit code 1 where anything did not hold.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))

from hostile import BACKENDS, Bench

EVERY = 10.0  # [s] between two lines of progress
PART = 20  # schedules that a process takes at a time
_bench: list[Bench] = []


def violations(backend: str, seeds: range) -> list[tuple[int, list[str]]]:
    """What did not hold in some schedules, by seed; the bench is set up once a process."""
    if not _bench:
        _bench.append(Bench())
    return [(seed, _bench[0].violations(seed, backend)) for seed in seeds]


def run(backend: str, seeds: range, processes: int) -> Iterator[tuple[int, list[str]]]:
    """The schedules of a backend, as they come."""
    parts = [seeds[i : i + PART] for i in range(0, len(seeds), PART)]
    if processes == 1 or len(seeds) == 1:
        for part in parts:
            yield from violations(backend, part)
        return
    with ProcessPoolExecutor(processes) as pool:
        for done in as_completed([pool.submit(violations, backend, part) for part in parts]):
            yield from done.result()


def main() -> int:
    """Run the schedules that were asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.probe.hostile", description=__doc__)
    parser.add_argument("--schedules", type=int, default=300, help="of each backend")
    parser.add_argument("--backend", choices=BACKENDS, help="default: all")
    parser.add_argument("--seed", type=int, help="replay this one alone")
    parser.add_argument("--first", type=int, default=0, help="seed of the first schedule")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="default: all cores")
    options = parser.parse_args()
    seeds = (
        range(options.first, options.first + options.schedules)
        if options.seed is None
        else range(options.seed, options.seed + 1)
    )
    failed = 0
    for backend in [options.backend] if options.backend else BACKENDS:
        began = told = time.monotonic()
        broken = 0
        for count, (seed, found) in enumerate(run(backend, seeds, options.processes), 1):
            broken += bool(found)
            for text in found:
                print(f"{backend} --seed {seed}: {text}", flush=True)
            if time.monotonic() - told > EVERY:
                told = time.monotonic()
                left = (told - began) / count * (len(seeds) - count)
                print(f"{backend}: {count} of {len(seeds)}, {broken} broken, {left:.0f} s left", file=sys.stderr)
        spent = time.monotonic() - began
        print(f"{backend}: {broken} of {len(seeds)} schedules broken, {spent:.0f} s", flush=True)
        failed += broken
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
