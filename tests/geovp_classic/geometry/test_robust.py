"""The median against numpy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.geometry.robust import median

numbers = st.lists(st.floats(-1e6, 1e6) | st.just(np.inf), min_size=1, max_size=40)


@given(numbers, st.sampled_from([np.float32, np.float64]))
def test_it_is_numpys(values: list[float], kind: type) -> None:
    given_values = np.array(values, kind)
    assert median(given_values) == np.median(given_values)
