"""Coverage-guided fuzzing of one reader: `python -m tests.coverage_fuzzing NAME [-max_total_time=60
...]`.

Needs `pip install atheris`, whose libFuzzer keeps inputs that reach new lines. The readers, and
what may become of a file, are those of `test_mutations.py`, but for other values in files with a
checksum: libFuzzer sees what checksums are compared with, and forges them. It stops at the first
input that ends in anything worse, and keeps it as `crash-*`.
"""

import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(
    include=["geovp_classic", "geovp_benchmarks", "geovp_learned", "yaml"]
):
    from tests import test_mutations


def main() -> None:
    """Fuzz the reader that the first argument names."""
    reader = test_mutations.READERS[sys.argv.pop(1)]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as corpus:
        path = reader.write(Path(folder))
        content, expected = path.read_bytes(), reader.read(path)
        (Path(corpus) / "good").write_bytes(content)

        def read_once(damaged: bytes) -> None:
            path.write_bytes(damaged)
            found = test_mutations.outcome(reader, path, expected)
            if found not in ("refused", "same", "other"):
                raise AssertionError(found)

        atheris.Setup([*sys.argv, corpus], read_once)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
