"""Numbers read eight characters at a time: the same as `float` reads, or none at all."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zeggs_jax.motion import decimals

NUMBERS = st.tuples(st.booleans(), st.integers(0, 10**15 - 1), st.integers(0, 14))
FILL = " 0.123456" * 500


def written(number: tuple[bool, int, int], places: int) -> str:
    """A whole number's digits, some cut off, with a point before the last ones."""
    minus, whole, cut = number
    digits = str(whole // 10**cut).rjust(places + 1, "0")[-15:]
    return "-" * minus + digits[:-places][-8:] + "." + digits[-places:]


@settings(max_examples=60, deadline=None)
@given(st.lists(NUMBERS, min_size=1, max_size=200), st.integers(1, 7), st.sampled_from([" ", "\n", " \n ", "\t\t"]))
def test_any_number_is_what_float_says(numbers, places, between):
    words = [written(number, places) for number in numbers]
    found = decimals.read(between.join(words).encode())
    assert found is not None
    expected = np.array([float(word) for word in words])
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


@pytest.fixture(scope="module", autouse=True)
def short_pieces():
    """Short texts too, in many pieces."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(decimals, "LEAST", 1)
        patch.setattr(decimals, "PIECE", 40)
        yield


@pytest.mark.parametrize(
    "odd", ["nan", "1e-5", "+1.000000", "1.0000000", "1.00000", "123456789.000000", "1,000000", "1.00-000", "1..00000",
            "--1.000000", "1.000000-", "1 .000000", "x2345678.000000", "inf", "0x1.000000", "-", ".", "7"]
)  # fmt: skip
@pytest.mark.parametrize("place", ["first", "middle", "last"])
def test_another_form_is_not_guessed(odd, place):
    parts = {"first": (odd, FILL), "middle": (FILL, " ", odd, FILL), "last": (FILL, " ", odd)}[place]
    assert decimals.read("".join(parts).encode()) is None


@pytest.mark.parametrize("text", ["", " ", "\n\n", "abc"])
def test_a_text_without_numbers_is_none(text):
    assert decimals.read(text.encode()) is None
