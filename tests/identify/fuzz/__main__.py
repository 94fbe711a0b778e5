"""Thousands of mutated files: `python -m tests.identify.fuzz --mutations 5000 [--seed 17]`."""

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))

from fuzz import Files


def main() -> int:
    """Read the mutations that were asked for; exit code 1 where a reader did what it may not do."""
    parser = argparse.ArgumentParser(prog="python -m tests.identify.fuzz", description=__doc__)
    parser.add_argument("--mutations", type=int, default=5000)
    parser.add_argument("--seed", type=int, help="replay this one alone")
    options = parser.parse_args()
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        files = Files(Path(folder))
        for seed in range(options.mutations) if options.seed is None else [options.seed]:
            if complaint := files.complaint(seed):
                failed += 1
                print(f"--seed {seed}: {complaint}", flush=True)
    print(f"{failed} of {options.mutations if options.seed is None else 1} mutations broken")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
