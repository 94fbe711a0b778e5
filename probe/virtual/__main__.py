"""Serve a virtual cell: `python -m probe.virtual --cell cell.yaml`."""

import sys

from probe.virtual.command import main

sys.exit(main())
