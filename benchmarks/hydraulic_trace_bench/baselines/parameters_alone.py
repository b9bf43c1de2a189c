"""Baseline: a fit of the declared parameters. It names no effect, so its answers are all silent by construction.

python baselines/parameters_alone.py CASES_FOLDER answers/parameters_alone.json
"""

import json
import sys
from pathlib import Path

cases, answers = Path(sys.argv[1]), Path(sys.argv[2])
answers.write_text(
    json.dumps({folder.name: [] for folder in sorted(cases.iterdir())}, indent=1) + "\n", encoding="utf-8"
)
