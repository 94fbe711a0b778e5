"""How touches are made: speeds, waits, tolerances and limits of patience."""

from dataclasses import dataclass

from identify.model.cell import DEG


@dataclass(frozen=True)
class Settings:
    """What an operator may tune; lengths are millimetres of the tip, times are seconds, angles are radians."""

    override: float = 1.0
    """0 ... 1, on every move but the search, whose speed the touch depends on."""
    move_speed: float = 500.0
    """[mm/s] of the tip between touches; slower by the override, on a first run above all."""
    retract_speed: float = 250.0
    """[mm/s] of the tip, straight back from the contact."""
    search_speed: float | None = None
    """[mm/s]; None: what the cell says."""
    fast_speed: float | None = None
    """[mm/s] of a first, quick search before the one that counts; None: without."""
    sure: float = 5.0
    """Standard deviations of a prediction: what is further off is a surprise."""
    near: float = 0.5
    """[mm] beyond what the prediction may be wrong by, from where on the tip searches."""
    near_speed: float = 100.0
    """[mm/s] of the tip from the approach to there."""
    back_off: float = 3.0
    """[mm] from the quick contact to where the slow search begins."""
    retries: int = 2
    """Of one touch."""
    misses: int = 3
    """Touches in a row without a hit that end the run."""
    further: float = 10.0
    """[mm] beyond an approach that the contact is still closed at."""
    stuck: float = 2.0
    """[s] for the sensing signal to clear once the wire is off the face; power sources need 0.5."""
    ramp: float = 0.2
    """[s] from rest to full joint speed, and back."""
    rest: float = 0.1
    """[s] for the contact to settle once the robot rests on it."""
    clears: float = 0.4
    """[s] until the sensing signal clears: power sources hold it 0.3 to 0.5 s."""
    stop_time: float = 0.25
    """[s] from the latch to standing still, at search speed."""
    arrived: float = 0.02 * DEG
    """[rad], [deg] read as [mm] of a sliding joint: how close is there."""
    off_line: float = 0.01 * DEG
    """[rad], how far a latch may lie off the commanded line."""
    disagreement: float = 1.0
    """[mm] beyond five sigma of the prediction: such a touch is repeated at once."""
    agreement: float = 0.3
    """[mm] between two touches of the same point."""
    again_every: int = 0
    """Touches between two repetitions of the first point, to see drift; 0: never."""
    dry_distance: float = 25.0
    """[mm] added to the distance of the approach points in a rehearsal."""
    trust_position: bool = False
    """The operator has checked where the robot stands, after a restart or a move by hand."""
    temperature: float | None = None
    """[degC] of the robot or the hall, noted with every touch."""
    note: str = ""
    """Free text that stands with every touch of the run."""
