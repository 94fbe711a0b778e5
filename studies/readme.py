"""The table of answers, studies/README.md, made from the scripts: `python -m studies.readme` writes it again."""

from pathlib import Path

from identify.model.files import write_text
from studies import PICTURES, STUDIES
from studies.engine import Study

HEAD = """# Studies

Questions about calibrating a robot by touch, each answered by one script of this folder. A study computes its table
and its pictures again with one command, with `pip install "touchcal[studies]"` on all cores of this machine or, by
`--scheduler ADDRESS`, on a Dask cluster.
What is finished is kept: a study that was interrupted goes on where it was. A seed gives the same table anywhere.

This page is made from the scripts by `python -m studies.readme`. In the study campaign, the rows of one shot and the
picture are older than plans that count with touches that miss and than fits that average joint errors; the rows of
campaigns are not.
"""


def readme() -> str:
    """The text of studies/README.md."""
    return "\n".join([HEAD, *(_section(Study.named(name)) for name in STUDIES)])


def _section(study: Study) -> str:
    rest = study.story.partition("\n\n")[2]
    charts = sorted(PICTURES.glob(f"{study.name}*.svg"))
    pictures = [f"![{study.question} ({path.stem})](pictures/{path.name})" for path in charts]
    command = f"```sh\ntouchcal study {study.name}\n```"
    return "\n\n".join([f"## {study.question}", rest, *pictures, command]) + "\n"


def main() -> None:
    """Write studies/README.md."""
    write_text(Path(__file__).parent / "README.md", readme())


if __name__ == "__main__":
    main()
