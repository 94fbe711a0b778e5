"""`touchcal virtual`: a cell behind a port, served by another process."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np

from probe.virtual.truth import read_truth

COMMAND = [str(Path(sys.executable).parent / "touchcal")]


def test_touches_go_through_a_port_that_another_process_serves(planned, touchcal):
    serve = [*COMMAND, "virtual", "--truth", "library:arc-welder", "--speed", "20"]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True, cwd=planned) as served:
        try:
            url = served.stdout.readline().strip()
            code, out, err = touchcal("run", "plan.csv", "--port", url, "--time-scale", "20", "--json")
        finally:
            served.send_signal(signal.SIGINT)

    assert code == 0, err
    assert json.loads(out)["hits"] == 3


def test_the_truth_file_that_the_help_shows_is_one(arc_welder, touchcal, tmp_path):
    shown = re.search(r"parameters:\s*\{[^}]*\}", touchcal("virtual", "--help")[1])
    (tmp_path / "truth.yaml").write_text(" ".join(shown[0].split()))

    theta = read_truth(tmp_path / "truth.yaml", arc_welder).theta

    changed = np.flatnonzero(theta != arc_welder.theta)
    assert [arc_welder.robot.parameters[i] for i in changed] == ["base.x", "j2.alpha"]
    np.testing.assert_allclose(theta[changed], [339.1, np.radians(1.2)])
