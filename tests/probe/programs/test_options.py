"""What an operator may choose: numbers that no controller can do are refused by the name of their option."""

import pytest

from identify.model.files import InputError
from probe.programs.options import Options


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (Options(wait=0.1), "--wait is 0.1, expected 0.3 to 10"),  # power sources hold the signal for 0.3 s
        (Options(first=0), "--first-register is 0"),
        (Options(registers=0), "--registers is 0"),
        (Options(per_file=10_000), "--per-file is 10000"),
        (Options(port=80), "--port is 80, expected 1024 to 65535"),
    ],
)
def test_what_no_controller_can_do_is_refused(options, name):
    with pytest.raises(InputError, match=name):
        options.check()


def test_the_usual_options_pass_and_the_search_is_as_fast_as_the_cell_says(arc_welder):
    Options().check()

    assert Options().settings(arc_welder).search_speed == arc_welder.touch.speed
    assert Options(search_speed=3.0).settings(arc_welder).search_speed == 3.0
