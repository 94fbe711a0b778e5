"""Thousands of mutated files: `python -m tests.identify.fuzz --mutations 5000 [--seed 17] [--readers]`.

Each goes through a command that reads it, or with `--readers` to its reader alone, which is quicker.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))

from fuzz import Files
from fuzz_commands import Commands

EVERY = 10.0  # [s] between two lines of progress


def main() -> int:
    """Read the mutations that were asked for; exit code 1 where a command or a reader did what it may not do."""
    parser = argparse.ArgumentParser(prog="python -m tests.identify.fuzz", description=__doc__)
    parser.add_argument("--mutations", type=int, default=5000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first mutation")
    parser.add_argument("--seed", type=int, help="replay this one alone")
    parser.add_argument("--readers", action="store_true", help="the readers alone, without the commands")
    options = parser.parse_args()
    first, count = (options.first, options.mutations) if options.seed is None else (options.seed, 1)
    failed, told = 0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        files = Files(Path(folder)) if options.readers else Commands(Path(folder))
        for done, seed in enumerate(range(first, first + count)):
            if complaint := files.complaint(seed):
                failed += 1
                print(f"--seed {seed}: {complaint}", flush=True)
            if time.monotonic() - told > EVERY:
                told = time.monotonic()
                print(f"{done + 1} of {count}, {failed} broken", file=sys.stderr, flush=True)
    print(f"{failed} of {count} mutations broken")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
