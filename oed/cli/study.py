"""`touchcal study`."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from identify.model.files import InputError
from oed.cli.options import Json, Seed, print_json
from oed.cli.screen.progress import progress

if TYPE_CHECKING:
    from oed.criteria.own import OwnCriterion
    from studies.engine import Compute


def study(
    name: str | None = None,
    *,
    output: Annotated[Path | None, Parameter(name=["-o", "--output"])] = None,
    small: Annotated[bool, Parameter(negative=())] = False,
    processes: int = 0,
    scheduler: str | None = None,
    tls_ca_file: str | None = None,
    tls_cert: str | None = None,
    tls_key: str | None = None,
    criterion: str | None = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Answer a question with numbers: a study computes its table and its pictures again; alone, lists the questions.

    What is finished is kept in the output folder: a study that was interrupted goes on where it was. The table is the
    same for a seed, on one process, on many, and on a cluster. Examples:

        touchcal study
        touchcal study observability --small
        touchcal study strategies --scheduler tcp://192.168.0.10:8786
        touchcal study strategies --criterion own.py:K2

    Parameters
    ----------
    name
        One of those that `touchcal study` alone lists.
    output
        The folder for table, pictures and finished parts; study-NAME if not given.
    small
        A few robots only: to see that it works.
    processes
        Worker processes on this machine, by the package `distributed`; one a core if not given.
    scheduler
        The address of a Dask scheduler whose workers have touchcal installed.
    tls_ca_file
        The certificate authority of a cluster with encrypted connections; with --tls-cert and --tls-key.
    tls_cert
        The certificate of this machine.
    tls_key
        Its key.
    criterion
        FILE.py:NAME, a criterion of your own (studies/examples/own_criterion.py) that strategies compares with V.
    """
    from studies.engine import Study, evaluate, write_results

    if name is None:
        _list_questions(json)
        return
    own = _own(criterion)
    study = Study.named(name, own)
    folder = Path(f"study-{name}" + (f"-{own.variable}" if own else "")) if output is None else output
    count, tls = processes or int(study.alone and not scheduler), (tls_ca_file, tls_cert, tls_key)
    with _compute(count, scheduler, tls) as using, progress(not json) as say:
        table = evaluate(study, folder, small=small, seed=seed, using=using, progress=say)
    files = write_results(study, table, folder)
    facts = {"study": name, "rows": len(next(iter(table.values()))), "files": [str(path) for path in files]}
    print_json(facts) if json else print(f"{study.answer(table)}\n\nwrote {', '.join(map(str, files))}")


def _list_questions(json: bool) -> None:
    """Print what each study asks."""
    from studies import STUDIES
    from studies.engine import Study

    questions = {name: Study.named(name).question for name in STUDIES}
    print_json(questions) if json else print("\n".join(f"{k:15}{q}" for k, q in questions.items()))


def _own(criterion: str | None) -> "OwnCriterion | None":
    """The criterion of a file; raises InputError for what names none."""
    from oed.criteria.own import OwnCriterion

    own = None if criterion is None else OwnCriterion.named(criterion)
    if criterion is not None and own is None:
        raise InputError(
            f"--criterion is '{criterion}', expected FILE.py:NAME; the study compares published ones anyway"
        )
    return own


def _compute(
    processes: int, scheduler: str | None, tls: tuple[str | None, str | None, str | None]
) -> AbstractContextManager["Compute"]:
    """Where the tasks are computed; raises InputError for words that do not go together."""
    import os
    import sys
    from importlib.util import find_spec

    from studies import cluster, engine

    if any(tls) and not (all(tls) and scheduler):
        raise InputError("--tls-ca-file, --tls-cert and --tls-key go together, and with --scheduler tls://...")
    if scheduler and processes:
        raise InputError("--processes is for this machine and --scheduler for a cluster; give one of them")
    if processes < 0:
        raise InputError(f"--processes is {processes}, expected 1 or more")
    if scheduler:
        return cluster.scheduler(scheduler, cluster.Tls(*tls))
    if not processes and find_spec("distributed") is None:
        print("touchcal: one process; pip install 'touchcal[studies]' to compute on all cores", file=sys.stderr)
        processes = 1
    count = processes or os.cpu_count() or 1
    return nullcontext(engine.here) if count == 1 else cluster.local(count)
