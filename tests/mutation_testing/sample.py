"""Keep a seeded random sample of a cosmic-ray session's pending mutants, and skip the others."""

import argparse
import random

from cosmic_ray.tools.filters.filter_app import FilterApp
from cosmic_ray.work_db import WorkDB
from cosmic_ray.work_item import WorkerOutcome, WorkResult


class Sample(FilterApp):
    """`python sample.py SESSION --count 60 --seed 1`."""

    def add_args(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--count", type=int, default=60)
        parser.add_argument("--seed", type=int, default=1)

    def filter(self, work_db: WorkDB, args: argparse.Namespace) -> None:
        place = {
            item.job_id: (str(m.module_path), m.operator_name, m.occurrence)
            for item in work_db.pending_work_items
            for m in item.mutations
        }
        shuffled = random.Random(args.seed).sample(
            sorted(place, key=lambda job: place[job]), len(place)
        )
        for job in shuffled[args.count :]:
            work_db.set_result(
                job, WorkResult(output="not in the sample", worker_outcome=WorkerOutcome.SKIPPED)
            )


if __name__ == "__main__":
    raise SystemExit(Sample().main())
