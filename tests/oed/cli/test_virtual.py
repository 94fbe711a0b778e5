"""`touchcal virtual`: a cell behind a port, served by another process."""

import json
import signal
import subprocess
import sys
from pathlib import Path

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
