"""All of these need torch; networks as small as these only wait for one another on more threads
than one.
"""

from collections.abc import Iterator

import pytest

REASON = "torch is not installed: the learned parts need the extra 'learned'"


def pytest_pycollect_makemodule() -> None:
    """Skip what needs torch before it is imported; the report says why."""
    pytest.importorskip("torch", reason=REASON)


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> Iterator[None]:
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
