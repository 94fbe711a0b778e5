"""Tasks of a study on a Dask cluster: processes of this machine, or a scheduler that runs already."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.model.files import InputError
from studies.engine import Compute, Task, compute

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 10.0  # [s] until a scheduler has to answer
RETRIES = 3  # of a task whose worker died
MISSING = "the package 'distributed' is not installed: pip install 'touchcal[studies]', or run with --processes 1"


@dataclass(frozen=True)
class Tls:
    """Files that a cluster with encrypted connections asks for; all or none."""

    ca_file: str | None = None
    cert: str | None = None
    key: str | None = None

    def __post_init__(self) -> None:
        for name in (self.ca_file, self.cert, self.key):
            if name is not None and not Path(name).is_file():
                raise InputError(f"{name}: no such file; --tls-ca-file, --tls-cert and --tls-key name PEM files")


@contextmanager
def local(processes: int) -> Iterator[Compute]:
    """A cluster of worker processes on this machine, gone again at the end."""
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise InputError(MISSING) from error
    cluster = LocalCluster(
        n_workers=processes, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, silence_logs="ERROR"
    )
    with cluster, Client(cluster) as client:
        yield _using(client)


@contextmanager
def scheduler(address: str, tls: Tls) -> Iterator[Compute]:
    """An existing cluster; raises InputError where its scheduler does not answer or has another touchcal."""
    try:
        from distributed import Client, Security
    except ImportError as error:
        raise InputError(MISSING) from error
    security = (
        Security(tls_ca_file=tls.ca_file, tls_client_cert=tls.cert, tls_client_key=tls.key, require_encryption=True)
        if tls.ca_file
        else None
    )
    try:
        client = Client(address, security=security, timeout=PATIENCE)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address} ({type(error).__name__}); start one with `dask scheduler` and "
            "give the address that it prints"
        ) from error
    with client:
        _check(client, address)
        yield _using(client)


def _check(client: "Client", address: str) -> None:
    """Raise InputError where there is no worker, or one with another version than ours."""
    ours = version()
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
        theirs = client.run(version)
    except TimeoutError as error:
        raise InputError(f"{address}: no worker is there; start some with `dask worker {address}`") from error
    except Exception as error:
        raise InputError(f"{address}: a worker cannot run touchcal ({error}); install it there too") from error
    other = {name: answer for name, answer in theirs.items() if answer != ours}
    if other:
        name, answer = next(iter(other.items()))
        raise InputError(f"{address}: worker {name} has touchcal {answer}, this machine {ours}; install the same one")


def version() -> str:
    """The version of touchcal, and what its studies are made of."""
    import hashlib
    from importlib.metadata import version as installed

    files = sorted(Path(__file__).parent.glob("*.py"))
    return f"{installed('touchcal')}+{hashlib.sha256(b''.join(f.read_bytes() for f in files)).hexdigest()[:8]}"


def _using(client: "Client") -> Compute:
    def run(name: str, tasks: Sequence[tuple[int, Task]], seed: int) -> Iterator[tuple[int, str]]:
        from distributed import as_completed

        futures: dict[Any, int] = {
            client.submit(compute, name, dict(task), seed, pure=False, retries=RETRIES): index for index, task in tasks
        }
        for future in as_completed(futures):
            yield futures[future], str(future.result())
            future.release()

    return run
