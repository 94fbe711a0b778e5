"""`touchcal health`: from a plan over the virtual robot to a verdict."""

import json

import pytest
from measured import TABLE_2


def test_from_plan_over_the_virtual_robot_to_the_verdict(found_folder, touchcal):
    code, out, _ = touchcal("health", "calibration.json")
    assert code == 0
    assert "zero of joint j2" in out

    code, out, _ = touchcal("health", "calibration.json", "--run")
    assert code == 0
    assert "unchanged: the robot is the one that was identified" in out
    values = TABLE_2 | {"tool.x": TABLE_2["tool.x"] + 1.0}
    (found_folder / "hit.yaml").write_text(json.dumps({"parameters": values}))

    code, out, _ = touchcal("health", "calibration.json", "--run", "--truth", "hit.yaml", "--json")
    assert code == 1
    told = json.loads(out)
    assert (told["verdict"], told["cause"]) == ("broken", "tool")
    assert told["change"] == pytest.approx([1, 0, 0], abs=0.2)
    assert (found_folder / "health-touches-2.csv").exists()
    assert touchcal("health", "calibration.json", "health-touches.csv")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["health", "calibration.json", "none.csv"], "none.csv: no such file"),
        (["health", "calibration.json", "none.csv", "--run"], "touches are given and --run asks for new ones"),
        (["health", "calibration.json", "--alarm", "2"], "--alarm is 2, expected a probability such as 0.01"),
        (["health", "calibration.json", "-n", "5"], "5 touches are too few to judge a robot by; plan 6 at least"),
    ],
)
def test_bad_input_gets_one_sentence_and_nothing_is_written(arguments, sentence, found_folder, touchcal):
    before = sorted(found_folder.rglob("*"))

    code, out, err = touchcal(*arguments)

    assert (code, out) == (2, "")
    assert sentence in err
    assert sorted(found_folder.rglob("*")) == before
