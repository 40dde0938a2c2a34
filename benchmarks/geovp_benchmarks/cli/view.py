"""Write a kept clip as a Rerun recording.

It holds images and camera paths. Needs the extra `viz`: pip install 'geovp-classic[viz]'.

Examples:
  geovp view results/demo street/000
  geovp view results/demo street/000 --methods copy-last
"""

import argparse

from geovp_benchmarks.cli.options import add, add_group, add_shared


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the clip and the methods."""
    add_shared(parser, "folder")
    add(parser, "clip", "CLIP", "Name of a clip whose predictions were kept, as in the report.")
    add_group(parser, "selection", "--methods")


def run(args: argparse.Namespace) -> int:
    """Write the file, and print the command that shows it."""
    from geovp_benchmarks.plots import recording
    from geovp_benchmarks.results.store import Results

    path = recording.write(Results(args.folder).select(*args.methods), args.clip)
    print(f"{path}\nshow it with: rerun '{path}'")
    return 0
