"""Thousands of hostile schedules: `python -m tests.probe.hostile --schedules 10000 [--backend line] [--seed 17]`.

With `--seed` one schedule is replayed alone; exit code 1 where anything did not hold.
"""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))

from hostile import BACKENDS, Bench


def main() -> int:
    """Run the schedules that were asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.probe.hostile", description=__doc__)
    parser.add_argument("--schedules", type=int, default=300)
    parser.add_argument("--backend", choices=BACKENDS)
    parser.add_argument("--seed", type=int, help="replay this one alone")
    parser.add_argument("--first", type=int, default=0, help="seed of the first schedule")
    options = parser.parse_args()
    bench, failed = Bench(), 0
    last = options.first + options.schedules
    seeds = range(options.first, last) if options.seed is None else [options.seed]
    for backend in [options.backend] if options.backend else BACKENDS:
        began, broken = time.perf_counter(), 0
        for seed in seeds:
            violations = bench.violations(seed, backend)
            broken += bool(violations)
            for text in violations:
                print(f"{backend} --seed {seed}: {text}", flush=True)
        spent = time.perf_counter() - began
        print(f"{backend}: {broken} of {len(seeds)} schedules broken, {spent:.0f} s", flush=True)
        failed += broken
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
