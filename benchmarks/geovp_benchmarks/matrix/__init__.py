"""Matrix files: schema, built-in files and protocols.

This module is imported for help texts and completion, so it imports nothing heavy.
"""

import re
from pathlib import Path

CONFIGS = Path(__file__).parents[1] / "configs"  # the built-in matrix files
PAPERS = CONFIGS.with_name("papers")  # matrix files that reproduce papers
DEVICE = re.compile(r"^(auto|cpu|cuda(:\d+)?)\Z")
