"""A study on a Dask cluster that a user started: the table of one process, whatever happens to a worker."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from oed.cli import main
from studies import cluster
from studies.engine import Study, evaluate, write_results

ROOT = Path(__file__).parents[2]
PATIENCE = 60.0  # [s] for a process to start on a busy machine


def start(folder, *arguments):
    """A process of Dask, started as a user would, whose output stays in a file."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    with (folder / f"{arguments[0]}-{time.monotonic_ns()}.log").open("w") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *map(str, arguments)], cwd=folder, env=environment, stdout=log, stderr=log
        )


def wait_for(what, condition):
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, f"no {what} within {PATIENCE:g} s"
        time.sleep(0.05)
    return found


@pytest.fixture(scope="module")
def dask(tmp_path_factory):
    """A scheduler and two workers on this machine: the address, and the workers."""
    folder = tmp_path_factory.mktemp("dask")
    told = folder / "scheduler.json"
    processes = [
        start(
            folder,
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            0,
            "--no-dashboard",
            "--no-show",
            "--scheduler-file",
            told,
        )
    ]
    try:
        wait_for("scheduler", told.exists)
        address = json.loads(told.read_text())["address"]
        worker = ("worker", address, "--nthreads", 1, "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        processes += [start(folder, *worker, "--local-directory", folder / str(k)) for k in range(2)]
        yield address, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The table of the small study, computed in this process."""
    folder, study = tmp_path_factory.mktemp("alone"), Study.named("observability")
    write_results(study, evaluate(study, folder, small=True, seed=0), folder)
    return (folder / "observability.csv").read_bytes()


def touchcal(*arguments):
    command = [sys.executable, "-c", "from oed.cli import main; main()", *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def test_a_cluster_gives_the_table_of_one_process_though_a_worker_is_killed(dask, alone, tmp_path):
    from distributed import Client

    address, workers = dask
    with Client(address, timeout=PATIENCE) as watching:
        watching.wait_for_workers(2, timeout=PATIENCE)
        run = touchcal("study", "observability", "--small", "--scheduler", address, "-o", tmp_path, "--json")
        busy = wait_for("run on both workers", lambda: all_busy(watching.processing()))
        workers[0].send_signal(signal.SIGKILL)
        out, err = run.communicate(timeout=120)

    assert (busy, run.returncode) == (2, 0), err.decode()
    assert json.loads(out)["rows"] == 20
    assert (tmp_path / "observability.csv").read_bytes() == alone

    # a run that was stopped before its last chunk: what is there is not computed again
    first, last = sorted((tmp_path / "chunks").iterdir())
    kept = first.stat().st_mtime_ns
    last.unlink()
    (tmp_path / "observability.csv").unlink()

    again = touchcal("study", "observability", "--small", "--scheduler", address, "-o", tmp_path)
    out, err = again.communicate(timeout=120)

    assert again.returncode == 0, err.decode()
    assert first.stat().st_mtime_ns == kept
    assert last.exists()
    assert (tmp_path / "observability.csv").read_bytes() == alone


def all_busy(processing):
    return len(processing) if all(processing.values()) else 0


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates of this test")
def test_encrypted_connections_need_the_certificates_of_the_cluster(tmp_path, monkeypatch, capsys):
    cert, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    made = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:prime256v1",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=127.0.0.1",
        "-keyout",
        str(key),
        "-out",
        str(cert),
    ]
    subprocess.run(made, check=True, capture_output=True)
    told = tmp_path / "scheduler.json"
    files = ("--tls-ca-file", cert, "--tls-cert", cert, "--tls-key", key)
    process = start(
        tmp_path,
        "scheduler",
        "--protocol",
        "tls",
        "--host",
        "127.0.0.1",
        "--port",
        0,
        "--no-dashboard",
        "--no-show",
        "--scheduler-file",
        told,
        *files,
    )
    monkeypatch.setattr(cluster, "PATIENCE", 3.0)

    try:
        address = json.loads(wait_for("scheduler", lambda: told.exists() and told.read_text()))["address"]
        said = [refusal(capsys, tmp_path / "study", "--scheduler", address, *more) for more in (files, ())]
    finally:
        process.kill()
        process.wait()

    assert address.startswith("tls://")
    assert "no worker is there" in said[0]
    assert "no Dask scheduler answers" in said[1]


def refusal(capsys, folder, *arguments):
    """The one sentence with which a study does not start."""
    with pytest.raises(SystemExit) as stop:
        main(["study", "observability", "--small", "-o", str(folder), *map(str, arguments)])

    err = capsys.readouterr().err
    assert stop.value.code == 2
    assert len(err.strip().splitlines()) == 1
    return err


BAD = {
    "nobody there": (("--scheduler", "tcp://127.0.0.1:1"), "no Dask scheduler answers at tcp://127.0.0.1:1"),
    "no address": (("--scheduler", "nowhere"), "no Dask scheduler answers at nowhere"),
    "two places": (("--scheduler", "tcp://127.0.0.1:1", "--processes", "2"), "give one of them"),
    "half of TLS": (("--scheduler", "tls://127.0.0.1:1", "--tls-cert", "c.pem"), "go together"),
    "TLS without a cluster": (("--tls-ca-file", "a", "--tls-cert", "b", "--tls-key", "c"), "with --scheduler"),
    "no such certificate": (
        ("--scheduler", "tls://127.0.0.1:1", "--tls-ca-file", "a.pem", "--tls-cert", "b.pem", "--tls-key", "c.pem"),
        "a.pem: no such file",
    ),
    "fewer than no processes": (("--processes", "-1"), "expected 1 or more"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_cluster_that_cannot_be_had_is_one_sentence(kind, tmp_path, monkeypatch, capsys):
    arguments, said = BAD[kind]
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)

    assert said in refusal(capsys, tmp_path, *arguments)
