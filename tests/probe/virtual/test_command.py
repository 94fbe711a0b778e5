"""The command of the virtual cell: it serves until it is ended, and answers bad input with one sentence."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from raw_host import RawHost, joints

from identify.model.io.description import library
from probe.virtual.command import main


@contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "probe.virtual", *arguments]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[3])
    try:
        yield running
    finally:
        running.kill()
        running.wait()
        running.stdout.close()


def test_the_command_serves_until_it_is_ended_and_leaves_a_log_and_no_port(arc_welder, plan, tmp_path):
    log, start = tmp_path / "log.jsonl", ",".join(f"{v:.9f}" for v in np.degrees(plan.approach[0]))
    cell = str(library("cells")["arc-welder"])
    arguments = [
        "--cell",
        cell,
        "--truth",
        "library:arc-welder",
        f"--start={start}",
        "--speed",
        "inf",
        "--log",
        str(log),
    ]
    with process(*arguments) as running:
        url = running.stdout.readline().strip()
        host = RawHost(url)
        host.say("0 HELLO process")
        host.say(f"1 MOVE {joints(plan.approach[0] + 0.01)} 5")
        moved = host.hear()
        host.close()
        running.send_signal(signal.SIGTERM)
        code = running.wait(timeout=20)

    rows = [json.loads(row) for row in log.read_text().splitlines()]
    assert moved.startswith("1 OK")
    assert code == 0
    assert [(row["motion"], row["outcome"]) for row in rows] == [("MOVE", "OK")]
    assert not os.path.lexists(url)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--cell", "none.yaml"], "none.yaml"),
        (["--speed", "0"], "speed is 0"),
        (["--start", "1,2"], "expected 6"),
        (["--truth", "library:arc-wleder"], "arc-welder"),
        (["--fault", "rebot@3"], "reboot"),
        (["--port", "serial"], "choose pty"),
    ],
)
def test_the_command_answers_bad_input_with_one_sentence_and_2(arguments, says, capsys):
    code = main(["--cell", str(library("cells")["arc-welder"]), *arguments])

    said = capsys.readouterr()
    assert code == 2
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert says in said.err
