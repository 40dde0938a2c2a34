"""A hundred samples at full size fit into two gigabytes: only their bytes are ever held together,
and no trainer.
"""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read from /proc")

PROGRAM = """
import sys

import numpy as np
from geovp_benchmarks.running import profiling
from geovp_classic import registry
from geovp_classic.types import Context, Intrinsics

random = np.random.default_rng(0)
frames = random.integers(0, 256, (10, 256, 256, 3), dtype=np.uint8)
context = Context(frames, np.arange(30) / 10, Intrinsics(489.0, 489.0, 127.5, 127.5, 256, 256))
profiling.reset_peak()
made = registry.build("predictors", "srvp-tiny").predict(context, num_samples=100).frames
assert "lightning" not in sys.modules, "takes three seconds to import"
print(made.shape, made.nbytes, profiling.peak_mb())
"""


def test_a_hundred_samples_of_twenty_frames() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
    )
    shape, _, rest = done.stdout.rpartition(") ")
    count, peak_mb = rest.split()
    assert shape == "(100, 20, 256, 256, 3"
    assert (
        int(count) == 100 * 20 * 256 * 256 * 3
    )  # 375 MiB, the samples themselves; as floats they would be 1.5 GiB
    assert float(peak_mb) < 1400
