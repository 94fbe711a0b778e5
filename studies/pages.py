"""The pages of the API, from the docstrings: `python -m studies.pages DIR`; they need pdoc (pip install pdoc)."""

import sys
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

PACKAGES = ("identify", "oed", "probe", "studies")
LEFT_OUT = ("!studies.racers", "!probe.virtual.__main__")  # they need the libraries of the race, or start a robot


def main() -> None:
    """Write them into the folder that is named."""
    import pdoc

    if len(sys.argv) != 2:
        sys.exit("usage: python -m studies.pages DIR")
    for name in PACKAGES:
        load(name)
    pdoc.pdoc(*PACKAGES, *LEFT_OUT, output_directory=Path(sys.argv[1]))


def load(name: str) -> None:
    """Load what the front of a package shows: pdoc sees only what is there, and what `__all__` names."""
    package = import_module(name)
    front = {entry: getattr(package, entry) for part in package._FRONT.values() for entry in part.split()}
    rooms = [module.name for module in iter_modules(package.__path__)]
    vars(package).update(front | {"__all__": [*front, *rooms]})


if __name__ == "__main__":
    main()
