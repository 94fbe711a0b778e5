"""`touchcal schema`."""

from typing import Any, Literal

from oed.cli.options import print_json

Kind = Literal["cell", "robot", "jig"]


def schema(kind: Kind = "cell") -> None:
    """Print the JSON schema of cell.yaml, robot.yaml or jig.yaml, by which editors check and complete it.

    touchcal init writes that of the cell beside cell.yaml, whose first line names it for editors that use the YAML
    language server. Example:

        touchcal schema jig > jig.schema.json

    Parameters
    ----------
    kind
        The file to describe.
    """
    print_json(schema_of(kind))


def schema_of(kind: Kind) -> dict[str, Any]:
    """The schema of a file that a user writes, from the model that validates it."""
    from pydantic import BaseModel

    from identify.model.io.schema import CellFile, JigFile, RobotFile

    models: dict[Kind, type[BaseModel]] = {"cell": CellFile, "robot": RobotFile, "jig": JigFile}
    return models[kind].model_json_schema()
