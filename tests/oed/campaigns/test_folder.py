"""A campaign's folder: one at a time, plans that are its own, and words without options that it does not have."""

import errno
import json
from dataclasses import replace

import pytest
from virtual_support import make_plan

from identify.model.files import InputError
from oed.campaigns.folder import Folder, as_campaigns_say, fingerprint, only_one, touches_of


def test_a_second_campaign_in_the_same_folder_is_refused(tmp_path):
    with only_one(tmp_path), pytest.raises(InputError, match="another program works on this"), only_one(tmp_path):
        pass

    with only_one(tmp_path):  # once the first is over
        pass


def test_a_full_disk_is_one_sentence_and_other_errors_pass(tmp_path):
    with pytest.raises(InputError, match="cannot be written: No space left on device; make room"), only_one(tmp_path):
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="not of the disk"), only_one(tmp_path):
        raise OSError("not of the disk")


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")

    with (
        pytest.raises(InputError, match=r"cannot be made: .*; choose another folder with -o"),
        only_one(tmp_path / "file"),
    ):
        pass


def test_a_plan_is_found_again_with_what_was_noted(arc_welder, tmp_path):
    folder, plan = Folder(tmp_path, arc_welder, {}), make_plan(arc_welder, 2)
    assert folder.planned(1) is None

    kept = folder.keep_plan(1, plan, {"approach_mm": 20.0, "travel_mm": 60.0})

    again, told = folder.planned(1)
    assert again.ids == kept.ids == plan.ids
    assert told["approach_mm"] == 20.0


def test_notes_that_are_no_plan_of_a_campaign_are_refused(arc_welder, tmp_path):
    (tmp_path / "plan-1.json").write_text(json.dumps({"promise": 1}))

    with pytest.raises(InputError, match=r"plan-1\.json: not of a campaign; choose another folder"):
        Folder(tmp_path, arc_welder, {}).planned(1)


def test_a_cell_is_the_same_at_another_port_and_not_with_another_tool(arc_welder):
    elsewhere = replace(arc_welder, controller=replace(arc_welder.controller, port="/dev/ttyS7"))

    assert fingerprint(elsewhere) == fingerprint(arc_welder)
    assert fingerprint(replace(arc_welder, tool=arc_welder.tool + 1.0)) != fingerprint(arc_welder)


def test_a_stage_counts_when_every_touch_of_its_plan_has_a_row(arc_welder, tmp_path):
    plan, path = make_plan(arc_welder, 2), tmp_path / "touches-1.csv"
    joints = ",".join(f"q{i}_deg" for i in range(1, 7))
    rows = [f"id,status,face,{joints}", f"{plan.ids[0]},hit,{plan.face[0]},10,20,30,40,50,60"]
    path.write_text("\n".join(rows) + "\n")
    assert touches_of(path, arc_welder, plan) is None

    path.write_text("\n".join([*rows, f"{plan.ids[1]},miss,{plan.face[1]}" + "," * 6]) + "\n")

    assert touches_of(path, arc_welder, plan).status == ("hit", "miss")


def test_a_campaign_says_what_to_do_in_its_own_words():
    said = as_campaigns_say("put that right, then go on with --resume --trust-position; or --resume")

    assert said == "put that right, then go on with the same command and --trust-position; or the same command"
