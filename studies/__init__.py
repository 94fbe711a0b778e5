"""Questions, each answered by one script: what it asks, how, and what came out, with numbers."""

from pathlib import Path

STUDIES = ("strategies", "paper", "models", "observability", "touches", "jig", "peers", "beyond", "campaign")
"""Every study is a module of this package: its docstring is question, setup and answer; `tasks`, `run`, `answer` and
`pictures` make it (`studies.engine.Study`)."""

PICTURES = Path(__file__).parent / "pictures"
