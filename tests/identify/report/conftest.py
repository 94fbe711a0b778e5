"""What pages of a report are made from."""

from dataclasses import replace

import pytest
from virtual_support import make_plan

from identify.report.plan import plan_page

UNREACHED = "front-low"
HOSTILE = "<script>document.title='owned'</script><!--"


@pytest.fixture(scope="module")
def plan_html(arc_welder):
    """The page of a plan of a cell with a hostile name."""
    cell = replace(arc_welder, robot=replace(arc_welder.robot, name=HOSTILE))
    told = {
        "promise": {"rms_mm": 0.05, "p95_mm": 0.1},
        "minutes": 3.0,
        "curve": [{"touches": 20, "p95_mm": 0.1}],
        "unseen": [HOSTILE],
        "missing": [0.0, *(0.3,) * 11],
        "notes": [f"face '{UNREACHED}' is out of reach"],
    }
    return plan_page(cell, make_plan(cell, 12, seed=5), told)
