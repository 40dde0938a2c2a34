"""Command lines, as in the tests of the harness."""

from tests.benchmarks.conftest import (  # noqa: F401
    _any_width,
    command,
    printed,
    refused,
)
