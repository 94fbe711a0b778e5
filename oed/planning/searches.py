"""Searches of planned touches by robots drawn from what is known: what each meets, and what its touches tell."""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from identify.model.measurement import Rows, measurement_model, touch_conditions
from identify.uncertainty.information import Information
from identify.uncertainty.promise import Promise, promise_over
from oed.candidates.candidates import Candidates
from oed.candidates.hits import MISSES, Outcome
from probe.motion.settings import Settings

ROBOTS = (250, 200, 125, 100, 50)  # drawn, the more the fewer touches there are
SEARCHES = 20_000  # at the most, or of the fewest robots
FAR = 2.0  # times the way to the planned contact, that searches are followed beyond it
STEPS = 4  # of the secant method: ways are nearly straight, and these leave nanometres
OFTEN = 0.1  # share of the robots that miss a touch, above which the touch is named
FEWEST = 0.05  # touches that miss for a reason, below which it is not named
NAMED = 5  # such touches at the most
MANY = 1 / 3  # share of the touches that miss, above which a fixed plan is not the way
CAMPAIGN = "use touchcal campaign"
STOPS = 0.05  # share of the robots whose run stops, above which a sentence says so


@dataclass(frozen=True, eq=False)
class Searches:
    """What robots drawn from what is known meet and learn with the same touches."""

    touches: Candidates
    outcomes: Int[np.ndarray, "robots touches"]
    information: Float[np.ndarray, "robots unknowns unknowns"]  # of touches that meet, in units of what was known

    def promise(
        self,
        tip: Float[np.ndarray, "poses 3 unknowns"],
        times: float = 1.0,
        further: Float[np.ndarray, "rows unknowns"] | None = None,
    ) -> Promise:
        """The tip error to expect over these robots if each touch is made so many `times`.

        `tip` are rows of points, and `further` whitened rows of other measurements that all robots make, in units of
        the deviations before the touches.
        """
        if further is None:
            gain, axes = self._spectrum
            return promise_over(tip, times * gain, axes)
        return promise_over(tip, *_spectrum(times * self.information + further.T @ further))

    @cached_property
    def _spectrum(self) -> tuple[Float[np.ndarray, "robots unknowns"], Float[np.ndarray, "robots unknowns unknowns"]]:
        return _spectrum(self.information)

    @cached_property
    def missing(self) -> Float[np.ndarray, " touches"]:
        """The share of the robots that miss each touch."""
        return np.asarray((self.outcomes != Outcome.MEETS).mean(axis=0))

    @cached_property
    def reasons(self) -> dict[str, float]:
        """Touches that miss, of the average robot, by what happens to them."""
        each = {words: float((self.outcomes == why).sum(axis=1).mean()) for why, words in MISSES.items()}
        return {words: count for words, count in each.items() if count > 0}

    def reason(self, i: int) -> str:
        """What most often happens to a touch that misses."""
        misses = self.outcomes[self.outcomes[:, i] != Outcome.MEETS, i].tolist()
        return MISSES[Outcome(Counter(misses).most_common(1)[0][0])] if misses else ""

    @cached_property
    def stopped(self) -> float:
        """The share of the robots whose run stops, since so many touches in a row miss."""
        most, row = Settings().misses, np.zeros(len(self.outcomes), dtype=int)
        over = np.zeros(len(row), dtype=bool)
        for outside in (self.outcomes != Outcome.MEETS).T:
            row = np.where(outside, row + 1, 0)
            over |= row >= most
        return float(over.mean())

    def sentences(self) -> tuple[str, ...]:
        """How many touches miss, which, and why; and how many robots stop."""
        total, n = float(self.missing.sum()), len(self.touches)
        if total < 0.005 * n:
            return ()
        reasons = sorted(((count, words) for words, count in self.reasons.items() if count >= FEWEST), reverse=True)
        why = ", ".join(f"{count:.1f} {words}" for count, words in reasons)
        out = [f"of {n} touches about {total:.1f} miss ({100 * total / n:.1f} %): {why}"]
        worst = np.argsort(-self.missing, kind="stable")[:NAMED]
        names = self.touches.names()
        often = [f"{i + 1} on {names[i]} ({100 * self.missing[i]:.0f} %)" for i in worst if self.missing[i] > OFTEN]
        if often:
            out.append(f"the touches that most often miss: {', '.join(often)}; the plan counts with it")
        if self.stopped > STOPS or total > MANY * n:
            row = f"{Settings().misses} touches in a row"
            stops = (
                f", and about {100 * self.stopped:.0f} of 100 runs stop, where {row} do" if self.stopped > STOPS else ""
            )
            out.insert(
                0,
                f"{CAMPAIGN}, which begins with few touches and long searches, or measure base and tool better: "
                f"{100 * total / n:.0f} % of the touches of a fixed plan miss with these tolerances{stops}",
            )
        return tuple(out)


def searches(prior: Information, touches: Candidates) -> Searches:
    """Let robots drawn from what is known make touches, each along its way to where the wire meets its face."""
    robots = next((k for k in ROBOTS if k * len(touches) <= SEARCHES), ROBOTS[-1])
    sample = _Drawn(prior, touches, prior.draws(robots, np.random.default_rng(0)))
    outcomes = sample.outcomes()
    rows = prior.root(sample.rows()) * (outcomes == Outcome.MEETS)[:, :, None]
    return Searches(touches, outcomes, rows.transpose(0, 2, 1) @ rows)


def _spectrum(
    information: Float[np.ndarray, "robots unknowns unknowns"],
) -> tuple[Float[np.ndarray, "robots unknowns"], Float[np.ndarray, "robots unknowns unknowns"]]:
    """Eigenvalues, not below 0, and eigenvectors."""
    gain, axes = np.linalg.eigh(information)
    return np.maximum(gain, 0.0), axes


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Robots that make the same touches; searches stand robot by robot."""

    prior: Information
    touches: Candidates
    x: Float[np.ndarray, "robots unknowns"]

    @cached_property
    def theta(self) -> Float[np.ndarray, "searches parameters"]:
        """Parameters of the robot of each search [mm, rad]."""
        unknowns, theta = self.prior.unknowns, np.tile(self.prior.theta, (len(self.x), 1))
        some = unknowns.parameters
        theta[:, some] += unknowns.scale[: len(some)] * self.x[:, : len(some)]
        return np.repeat(theta, len(self.touches), axis=0)

    @cached_property
    def equations(self) -> Rows:
        """The equations of the touches as they are planned."""
        return self.touches.rows(self.prior.unknowns.cell)

    @cached_property
    def shared(self) -> Float[np.ndarray, "touches shared"]:
        """Derivatives of residuals by what touches share [mm]."""
        return self.prior.unknowns.shared_slopes(self.equations, self.prior.theta)

    def q(self, share: Float[np.ndarray, " searches"]) -> Float[np.ndarray, "searches joints"]:
        """Joint values on the ways from the approach, 1 being the planned contact."""
        robots, touches = len(self.x), self.touches
        way = np.tile(touches.q - touches.approach, (robots, 1))
        return np.asarray(np.tile(touches.approach, (robots, 1)) + share[:, None] * way)

    def tips(self, share: Float[np.ndarray, " searches"]) -> tuple[np.ndarray, np.ndarray]:
        """Positions [mm] and rotations of the tips there."""
        position, rotation = self.prior.unknowns.cell.kinematics.tip(self.q(share), self.theta)
        return position, rotation

    def outcomes(self) -> Int[np.ndarray, "robots touches"]:
        """What each search meets, its way straight between approach and contact."""
        shape = (len(self.x), len(self.touches))
        zero, touches = np.zeros(shape[0] * shape[1]), self.touches
        start, contact = (self.tips(zero + share)[0].reshape(*shape, 3) for share in (0.0, 1.0))
        wire, out = self.prior.unknowns.cell.wire, np.empty(shape, dtype=np.int8)
        extent = wire.ball + wire.flat * np.sin(touches.tilt)
        for i in np.unique(touches.face).tolist():
            some = np.flatnonzero(touches.face == i)
            way = contact[:, some] - start[:, some]
            out[:, some] = touches.hits.outcome(i, start[:, some], way, extent[some])
        return out

    def rows(self) -> Float[np.ndarray, "robots touches unknowns"]:
        """Whitened rows of the touches, at each robot where its wire meets the face."""
        unknowns, robots, n = self.prior.unknowns, len(self.x), len(self.touches)
        q, sigma = self.q(self._met()), np.tile(self.equations.sigma, robots)
        rows = Rows(
            q,
            np.tile(self.touches.normal, (robots, 1)),
            np.tile(self.equations.offset, robots),
            np.tile(self.equations.radius, robots),
            sigma,
            (),
            np.arange(robots * n),
            touch_conditions(q, np.tile(self.touches.approach, (robots, 1))),
        )
        _, J = measurement_model(unknowns.cell.robot).linearize(self.theta, rows)
        own = J[:, unknowns.parameters] * unknowns.scale[: len(unknowns.parameters)]
        shared = np.tile(self.shared, (robots, 1))
        rest = np.zeros((len(q), len(unknowns) - own.shape[1] - shared.shape[1]))
        return np.asarray((np.hstack([own, shared, rest]) / sigma[:, None]).reshape(robots, n, -1))

    def _met(self) -> Float[np.ndarray, " searches"]:
        """Where on its way each wire meets the plane of its face, by the secant method; somewhere if it never does."""
        robots, wire = len(self.x), self.prior.unknowns.cell.wire
        first = len(self.prior.unknowns.parameters)
        off = self.x[:, first : first + self.shared.shape[1]] @ self.shared.T
        plane, normal = np.tile(self.equations.offset, robots) - off.ravel(), np.tile(self.touches.normal, (robots, 1))

        def gap(share: Float[np.ndarray, " searches"]) -> Float[np.ndarray, " searches"]:
            tip, R = self.tips(share)
            lean = (R[:, :, 2] * normal).sum(axis=1)
            extent = wire.flat * np.sqrt(np.maximum(1 - lean**2, 0.0))
            return np.asarray((tip * normal).sum(axis=1) - plane - extent)

        a, b = np.zeros(len(plane)), np.ones(len(plane))
        before, now = gap(a), gap(b)
        for _ in range(STEPS):
            step = -now * (b - a) / np.where(now == before, 1.0, now - before)
            a, b, before = b, np.clip(b + step, 0.0, 1 + FAR), now
            now = gap(b)
        return b
