"""Reading a command for its help without loading what it works with: CasADi, NumPy and our rooms take a second."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

HERE = "oed.cli"
ROOMS = ("identify", "probe", "studies", "oed", "numpy", "scipy", "jaxtyping", "ruamel")


class _Nothing(ModuleType):
    """Stands for a module and for whatever is taken from it; good for a name in a signature, and for no work at all."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Nothing(f"{self.__name__}.{name}")

    def __getitem__(self, shape: Any) -> "_Nothing":
        return self

    def __or__(self, other: Any) -> Any:
        return self

    __ror__ = __or__


class _Finder(MetaPathFinder, Loader):
    """Finds nothing in our rooms, but for the command line, and in what they are built on."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        ours = name == HERE or name.startswith(f"{HERE}.")
        return None if ours or name.partition(".")[0] not in ROOMS else ModuleSpec(name, self, is_package=True)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Nothing(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


@contextmanager
def unloaded() -> Iterator[None]:
    """Commands imported meanwhile can be read, not run; what was not loaded before is not afterwards."""
    before, finder = set(sys.modules), _Finder()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        for name in [name for name in sys.modules if name not in before and name.partition(".")[0] in ROOMS]:
            del sys.modules[name]
            room, _, own = name.rpartition(".")
            vars(sys.modules.get(room, _Nothing(room))).pop(own, None)
