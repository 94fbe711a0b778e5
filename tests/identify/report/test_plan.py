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


def test_touches_are_coloured_by_how_many_robots_meet_them(plan_html):
    touches = json.loads(re.search(r'id="scene">(.*?)</script>', plan_html, flags=re.S).group(1))["touches"]

    assert touches[0]["colour"].startswith("hsl(120,")  # green
    assert all(touch["colour"].startswith("hsl(0,") for touch in touches[1:])
    assert [touch["words"] for touch in touches] == ["100 of 100 robots meet it", *("70 of 100 robots meet it",) * 11]


def test_a_face_without_touches_says_why(plan_html, arc_welder):
    faces = json.loads(re.search(r'id="scene">(.*?)</script>', plan_html, flags=re.S).group(1))["faces"]
    touched = set(make_plan(arc_welder, 12, seed=5).face)

    assert {face["name"] for face in faces if face["bare"]} == {f.name for f in arc_welder.jig.faces} - touched
    assert plan_html.count("can be touched; others tell more") == len(faces) - len(touched | {"front-low"})
    assert re.search(r">face &#x27;front-low&#x27; is out of reach<", plan_html) or "front-low" in touched
