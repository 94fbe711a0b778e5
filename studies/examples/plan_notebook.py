"""A plan in the style of a notebook: choose touches, let a hidden robot make them, identify it, verify."""

# %% The cell of the paper, and 40 touches that tell the most about its robot.
import numpy as np

import identify
import oed
import probe

rng = np.random.default_rng(1)
cell = identify.read_cell(identify.library("cells")["arc-welder"])
result = oed.plan(cell, 40, "V", rng=rng, count=2000)
print(f"{len(result.plan)} touches in {result.minutes:.0f} minutes promise {result.promise.p95_mm:.3f} mm")

# %% A robot as its tolerances allow it, which nobody knows: here it stands for the real one.
truth = probe.draw_truth(cell, rng, scale=0.1)
touches = probe.touch_batch(cell, truth, result.plan, rng)

# %% What the touches tell of it.
calibration = identify.calibrate(cell, touches)
print(f"{len(calibration.estimated)} parameters, fit to {calibration.fit.rms_mm:.3f} mm")

# %% An accuracy comes from touches that were not used: here from a random plan.
unseen = oed.plan(cell, 30, strategy="random", rng=rng, count=2000)
errors = identify.verify(calibration, probe.touch_batch(cell, truth, unseen.plan, rng))
print(f"unseen touches: before {errors.nominal.rms_mm:.3f} mm, after {errors.identified.rms_mm:.3f} mm")
