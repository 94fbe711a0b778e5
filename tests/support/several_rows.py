"""Twelve measurements of one and of three rows."""

import numpy as np

P = 5
OWNER = np.repeat(np.arange(12), [1, 3, 1, 1, 3, 1, 1, 3, 1, 1, 3, 1])
