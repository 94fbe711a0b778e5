"""Sequential calibration: touch, identify, plan the next touches with what is known, until the promise is good."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identify.estimation.calibrate import CalibrationFailed, calibrate
from identify.estimation.face_association import Belief, believe, believed, provisional
from identify.estimation.verdict import refusals, with_promise
from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.identifiability import structure
from identify.model.io.calibration_file import Calibration
from identify.model.touch import HIT, Plan, Touches, joined
from identify.model.zone import zone_poses
from identify.uncertainty.information import Information
from identify.uncertainty.posterior import tip_errors, zone_promise
from identify.uncertainty.promise import TipErrors, worst_deviation
from identify.uncertainty.unknowns import Unknowns
from oed.campaigns.more_touches import MoreTouches
from oed.campaigns.stages import Campaign, CampaignStore, Job, NullStore, Stage
from oed.planning.plan import plan as make_plan
from oed.planning.uncertain import UncertainEdges, begun, plan_under_uncertainty
from probe.line.controller import TouchError
from probe.motion.clearance import Clearance
from probe.motion.torch import STICKOUT

SPARE = 5  # touches beyond the number of parameters, before the touches alone are asked
SCOUTS = 8  # touches of a stage that looks for the jig
LONGEST = 80.0  # [mm], approach of a search for a badly known robot
SHARES = (1.0, 0.7, 0.4, 0.0)  # of the length that a search asks for, tried one after the other
SIGMAS = 2.0  # of the tip's deviation that an approach stays off
BATCH = 40  # touches of a stage at the most
LEAST = 8  # and at the least
WORTH = 0.02  # of the promise that ten more touches must gain
STAGES = 40
PAST = STICKOUT - 3.0  # [mm] of search behind the contact: where the wire slides past an edge, the nozzle stays clear
STANDOFF = 15.0  # [mm], of an approach beyond that, on the ways around a jig that is not quite where it seems
ARRIVED = (HIT, "miss", "outlier")  # touches that the robot did approach


Touch = Callable[[Job], Touches]
Planner = Callable[[Cell, int, np.random.Generator, Calibration | None], Plan]


def campaign(
    cell: Cell,
    *,
    target_mm: float,
    max_touches: int = 250,
    rng: np.random.Generator,
    touch: Touch,
    keep: CampaignStore | None = None,
    planner: Planner | None = None,
    batch: int = BATCH,
    tell: Callable[[Stage], None] = lambda stage: None,
    progress: Callable[[str, float], None] | None = None,
) -> Campaign:
    """Touch and identify by turns until 95 % of the tip errors in the zone are promised to stay below the target.

    The first stages search far, for a robot that may be off by its tolerances; the later ones plan with what is known.
    `touch` makes the touches of a job; `planner` plans all but those of the first, far searches, at most `batch` at a
    time. Ends where the target is reached, the touches are used up, or more would not help. Raises InputError where
    nothing can be planned, and TouchError where the jig is not met.
    """
    check_limits(cell, target_mm, max_touches)

    say = progress or (lambda what, share: None)

    def carefully(cell: Cell, n: int, rng: np.random.Generator, after: Calibration | None) -> Plan:
        def planning(what: str, _: float) -> None:
            say(f"planning: {what}", loop.tried / max_touches)

        return make_plan(cell, n, rng=rng, after=after, lifting=False, progress=planning).plan

    loop = _Loop(cell, target_mm, max_touches, rng, touch, keep or NullStore(), planner or carefully, batch)
    stages = list[Stage]()
    for stage in loop.stages(say):
        stages.append(stage)
        tell(stage)
    return Campaign(tuple(stages), target_mm, loop.reached, loop.why)


def check_limits(cell: Cell, target: float, most: int) -> None:
    """Raise InputError if the target [mm] is none, or if so few touches cannot identify the robot."""
    least = structure(cell).rank + SPARE
    if not target > 0:
        raise InputError(f"target {target:g} mm: write the 95 % tip error in the zone that is wanted, above 0")
    if most < least:
        raise InputError(f"{most} touches cannot identify robot '{cell.robot.name}'; allow at least {least}")


class _Loop:
    """What a campaign knows while it runs."""

    def __init__(
        self,
        cell: Cell,
        target: float,
        most: int,
        rng: np.random.Generator,
        touch: Touch,
        keep: CampaignStore,
        planner: Planner,
        batch: int,
    ) -> None:
        self.cell, self.target, self.most, self.rng, self.touch, self.keep = cell, target, most, rng, touch, keep
        self.planner, self.batch = planner, batch
        self.enough = structure(cell).rank + SPARE
        self.tried, self.met = 0, _none(cell)
        self.belief: Belief | None = None
        self.after: Calibration | None = None
        self.promised: float | None = None
        self.wanted = SCOUTS
        self.trail: Plan | None = None  # the last stage: where the robot has been, and stands
        self.reached, self.why = False, ""

    def stages(self, say: Callable[[str, float], None]) -> Iterator[Stage]:
        """One stage after the other, until there is a reason to end; how far it is, is the share of touches tried."""
        for number in range(1, STAGES + 1):
            rng = self.rng.spawn(1)[0]  # of its own, so that a campaign that goes on later draws the same
            say(f"stage {number}: planning", self.tried / self.most)
            job = self._job(number, rng)
            say(f"stage {number}: {len(job.plan)} touches", self.tried / self.most)
            stage = self._made(job)
            yield stage
            self._decide(stage)
            if self.why:
                return
        self.why = f"{STAGES} stages were made"

    def _job(self, number: int, rng: np.random.Generator) -> Job:
        """The plan of a stage: the one that is kept, or a new one."""
        deviation = self._deviation()
        stored = self.keep.planned(number)
        if stored is None:
            plan, approach = self._planned(min(self.wanted, self.most - self.tried), deviation, rng)
            notes = {"stage": number, "approach_mm": approach[0], "travel_mm": approach[1], "deviation_mm": deviation}
            plan = self.keep.keep_plan(number, plan, notes)
        else:
            plan, notes = stored
            approach = (float(notes["approach_mm"]), float(notes["travel_mm"]))
        cell = _searching(self.cell, approach)
        cell = cell if self.after is None else believed(cell, self.after.theta)
        return Job(number, cell, plan, self.promised is None, deviation)

    def _planned(self, n: int, deviation: float, rng: np.random.Generator) -> tuple[Plan, tuple[float, float]]:
        """A plan whose searches are as long as the deviation of the tip asks, or as the jig and the robot allow."""
        reach = min(SIGMAS * deviation, LONGEST)
        standoff = STANDOFF if self.promised is None else 0.0
        own = self.cell.touch.approach, self.cell.touch.travel - self.cell.touch.approach
        reason: InputError | None = None
        for after in (
            (self.after, None) if self.promised is None else (self.after,)
        ):  # as at first, where all else fails
            for share in SHARES:
                approach = max(own[0], share * (reach + standoff))
                beyond = max(min(own[1], PAST), share * reach)
                try:
                    plan = self._chosen(_searching(self.cell, (approach, approach + beyond)), n, rng, after)
                except InputError as error:
                    reason = reason or error
                    continue
                plan = plan.take(np.arange(min(len(plan), self.most - self.tried)))
                return _named(plan, self.tried), (approach, approach + beyond)
        assert reason is not None
        raise reason

    def _chosen(self, cell: Cell, n: int, rng: np.random.Generator, after: Calibration | None) -> Plan:
        """Touches for a robot that is hardly known, or planned with care."""
        if self.promised is None or after is None:
            return plan_under_uncertainty(cell, n, rng, after, self.trail)
        plan = self.planner(cell, n, rng, after)
        started = begun(plan, UncertainEdges(Clearance(cell, after.theta), robots=after.theta[None]), self.trail)
        stuck = started is plan and self.trail is not None  # no way leads to any of them from where the robot stands
        return plan_under_uncertainty(cell, n, rng, after, self.trail) if stuck else started

    def _made(self, job: Job) -> Stage:
        """Touch, then identify from all touches so far."""
        touches = self.touch(job)
        self.tried += len(touches)
        status = dict(zip(touches.ids, touches.status, strict=True))
        arrived = [i for i, name in enumerate(job.plan.ids) if status.get(name) in ARRIVED]
        self.trail = job.plan.take(np.array(arrived)) if arrived else self.trail
        self.met = joined(self.met, touches.measured())
        if not len(self.met):
            raise TouchError(
                f"none of {self.tried} touches met the jig; are jig, base and tool where the cell file says, and its "
                "priors honest?"
            )
        self.belief = believe(self.cell, self.met, self.belief)
        good = self.met.take(self.belief.as_planned(self.met))
        self.after, calibration, self.promised = self._identified(good)
        self.keep.keep_calibration(job.number, calibration)
        return Stage(job, touches, calibration, self.promised)

    def _identified(self, good: Touches) -> tuple[Calibration, Calibration, float | None]:
        """The robot to plan with, the calibration to hand out, and what it promises [mm]; None for too few touches.

        The next touches are planned for the joint errors that the cell names. What is promised is what `identify` says.
        """
        assert self.belief is not None
        if len(good) >= self.enough:
            try:
                planned_with = calibrate(self.cell, good, start=self.belief.theta, errors="cell")
                calibration = self._as_identify(good) or planned_with
                now = zone_promise(calibration).p95_mm
                self.more = MoreTouches(planned_with, good, now)
                return planned_with, calibration, now
            except InputError:  # so many, and still not of full rank
                pass
        guess = provisional(self.cell, self.belief)
        return guess, guess, None

    def _as_identify(self, good: Touches) -> Calibration | None:
        """What `identify` says of all touches that met something, else of the good ones; None where it refuses both."""
        for touches in (self.met, good):
            try:
                calibration = with_promise(calibrate(self.cell, touches))
            except (InputError, CalibrationFailed):
                continue
            if not refusals(calibration):
                return calibration
        return None

    def _deviation(self) -> float:
        """How far the tip may be off [mm], 1 sigma."""
        theta = self.cell.theta if self.after is None else self.after.theta
        poses = zone_poses(self.cell, theta, 100)
        if self.after is not None:
            return worst_deviation(tip_errors(self.after, poses))
        unknowns = Unknowns.of(replace(self.cell, base=theta[:6], tool=theta[-6:]))  # what is to be fitted is nominal
        return worst_deviation(TipErrors(Information.prior(unknowns).root(unknowns.tip_rows(poses))))

    def _decide(self, stage: Stage) -> None:
        """Whether and why to end, or how many touches to plan next."""
        remaining = self.most - self.tried
        if self.promised is None:
            searching = SIGMAS * self._deviation() > self.cell.touch.approach
            self.wanted = SCOUTS if searching else max(LEAST, self.enough - len(self.met))
            if remaining < 1:
                self.why = f"{self.tried} touches are used up before the robot could be identified"
            return
        floor = self.more.floor
        if self.promised <= self.target:
            self.reached, self.why = True, f"the target of {self.target:g} mm is reached"
            return
        goal = self.target if floor < 0.97 * self.target else 1.1 * floor
        if self.promised <= goal:
            self.why = f"more touches do not help: {self._reason(floor)}{self._cure()}"
        elif remaining < 1:
            self.why = f"all {self.most} touches are used up: {self._reason(floor)}{self._advice()}{self._cure()}"
        else:
            more = (self.more.times(goal) - 1) * len(self.met)
            gain = 1 - self.more.promised(1 + 10 / len(self.met)) / self.promised
            if gain < WORTH and more > remaining:
                self.why = f"more touches hardly help: {self._reason(floor)}{self._advice()}{self._cure()}"
            self.wanted = int(np.clip(np.ceil(more if more < BATCH / 2 else 0.7 * more), LEAST, self.batch))

    def _advice(self) -> str:
        """How many touches would do, where some would."""
        most = self.more.times(self.target) * self.tried
        return f"; about {10 * np.ceil(most / 10):.0f} touches reach {self.target:g} mm" if np.isfinite(most) else ""

    def _cure(self) -> str:
        """The face that would help most, where the account of what is known names one."""
        return f". {self.more.limit} That may be a larger jig, or a second one there"

    def _reason(self, floor: float) -> str:
        """What keeps the error up, in words."""
        tolerance = max(face.tolerance for face in self.cell.the_jig.faces)
        return (
            f"promised are {self.promised:.3f} mm; {floor:.3f} mm would stay however often these are made, because the "
            f"faces of the jig stand where they should to {tolerance:g} mm (1 sigma), and joint errors may hide from "
            f"them; the rest is the scatter of a touch, {self.cell.touch.sigma:g} mm"
        )


def _searching(cell: Cell, length: tuple[float, float]) -> Cell:
    return replace(cell, touch=replace(cell.touch, approach=length[0], travel=length[1]))


def _named(plan: Plan, before: int) -> Plan:
    """The touches of all stages are counted through."""
    return replace(plan, ids=tuple(str(before + i + 1) for i in range(len(plan))))


def _none(cell: Cell) -> Touches:
    empty: Float[np.ndarray, " touches"] = np.empty(0)
    q: Float[np.ndarray, "touches joints"] = np.empty((0, len(cell.robot.joints)))
    return Touches((), (), q, np.empty((0, 3)), empty, empty, (), empty, (), (), q)
