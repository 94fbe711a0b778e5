"""How many robots a minute and core, and what a second worker buys.

Run with pytest tests/benchmarks/test_studies.py --benchmark-only; the second on a machine that has two cores to spare.
"""

import time

import numpy as np
import pytest
from virtual_support import make_plan

from studies import cluster
from studies.engine import Study
from studies.many import calibrate_many, draw_many, touch_every

ROBOTS, CHUNKS = 200, 8


@pytest.mark.parametrize("eliminate", [True, False])
def test_calibrations_of_42_parameters_from_50_touches(benchmark, arc_welder, eliminate):
    rng = np.random.default_rng(0)
    theta = draw_many(arc_welder, ROBOTS, rng)
    touches = touch_every(arc_welder, theta, make_plan(arc_welder, 50), rng)
    begin = time.process_time()
    calibrate_many(arc_welder, touches, eliminate=eliminate)
    benchmark.extra_info["calibrations a minute and core"] = round(60 * ROBOTS / (time.process_time() - begin))

    found = benchmark(lambda: calibrate_many(arc_welder, touches, eliminate=eliminate))

    assert found.converged.mean() > 0.95


def test_two_workers_against_one(benchmark):
    task = Study.named("observability").tasks(small=False)[0] | {"sets": 2}
    tasks = [(i, task | {"part": i}) for i in range(CHUNKS)]
    took = {}

    def measure():
        for processes in (1, 2):
            with cluster.local(processes) as compute:
                list(compute("observability", tasks, 0))  # workers compile and find their touches once
                begin = time.perf_counter()
                list(compute("observability", tasks, 0))
                took[processes] = time.perf_counter() - begin

    benchmark.pedantic(measure, rounds=1)

    benchmark.extra_info["times as fast with two workers"] = round(took[1] / took[2], 2)
    print(f"\ntwo workers are {took[1] / took[2]:.2f} times as fast as one")
