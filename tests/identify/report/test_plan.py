"""The page of a plan shows the paths that the tip will take."""

import json
import re

import numpy as np
from virtual_support import make_plan

HOSTILE = "<script>document.title='owned'</script><!--"


def test_the_paths_of_a_plan_lead_from_approach_to_approach(plan_html, arc_welder):
    plan = make_plan(arc_welder, 12, seed=5)
    data = json.loads(re.search(r'id="scene">(.*?)</script>', plan_html, flags=re.S).group(1))

    tips = arc_welder.kinematics.tip(plan.approach, arc_welder.theta)[0]

    np.testing.assert_allclose([path[-1] for path in data["paths"]], tips, atol=0.051)
    np.testing.assert_allclose([path[0] for path in data["paths"][1:]], tips[:-1], atol=0.051)
