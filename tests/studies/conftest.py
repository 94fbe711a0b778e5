"""What tests of studies and examples share."""

from collections.abc import Iterator

import pytest

from oed.planning import strategies, visitable
from oed.refinement import certificate


@pytest.fixture(scope="module", autouse=True)
def quick_plans() -> Iterator[None]:
    """Plans with less search: here they need not be the best, only better than others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certificate, "STARTS", 8)
        patch.setattr(visitable, "ROBOTS", 8)
        patch.setattr(strategies, "SEARCHES", 6)
        patch.setattr(strategies, "SWEEPS", 1)
        yield
