import pytest
from maker_bench import BROKEN, STICKS, make
from probe.programs.options import Options
import numpy as np

@pytest.mark.parametrize("maker", ["ur"])
def test_x(bench, live, maker, tmp_path):
    made = make(bench, maker, tmp_path, Options(), broken=BROKEN, sticks=STICKS)
    hit=[i for i,s in enumerate(made.touches.status) if s=='hit' and live.status[i]=='hit']
    d=np.degrees(made.touches.q[hit]-live.q[hit])
    step=np.degrees(bench.plan.q-bench.plan.approach)[hit]
    for k in np.argsort(-np.abs(d).max(axis=1))[:6]:
        print(hit[k], d[k].round(5), step[k].round(4), (d[k]/step[k]).round(6))
