"""Touches as they are made: a line each where nobody watches, and none where silence is asked for."""

from oed.cli.screen.live import ROWS, Screen
from probe.runs.events import Drifted, Retried, Started, Touched, Touching

NAN = float("nan")


def touched(done: int, **changes: object) -> Touched:
    usual = {"id": f"t{done}", "face": "top", "status": "hit", "residual": 1.25, "surprise": NAN, "expected": NAN}
    usual |= {"attempts": 1, "done": done, "total": 20, "seconds_left": 90.0, "note": ""}
    names = Touched.__dataclass_fields__
    return Touched(**{name: value for name, value in (usual | changes).items() if name in names})


def test_a_file_gets_a_line_for_each_thing_that_happened(capsys):
    with Screen() as screen:
        for event in (Started(20, 3, "a robot"), Touching("t4", "top", 2), Retried("t4", 2, "the wire slipped")):
            screen.tell(event)
        screen.tell(touched(4, note="warm"))
        screen.tell(Drifted("t1~2", -0.0625))

    assert capsys.readouterr().err.splitlines() == [
        "a robot: 20 touches, 3 made before",
        "touch t4, attempt 2: the wire slipped",
        "[4/20] t4 top hit residual +1.250 mm surprise - mm, warm, 1.5 min left",
        "touch t1~2: -0.062 mm from its first time",
    ]


def test_silence_is_silent(capsys):
    with Screen(silent=True) as screen:
        screen.tell(Started(20, 0, "a robot"))
        screen.tell(touched(1))

    assert capsys.readouterr().err == ""


def test_the_last_touches_stay_in_sight(capsys):
    screen = Screen(silent=True)

    for k in range(1, ROWS + 5):
        screen.tell(touched(k))

    assert [row[0] for row in screen.rows] == [f"t{k}" for k in range(5, ROWS + 5)]
