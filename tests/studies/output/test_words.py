"""Numbers in sentences: as many digits as are told, and none written as a power where it has a plain form."""

from __future__ import annotations

import pytest

from studies.output.words import digits


@pytest.mark.parametrize("value", [0.123456, 9.995, 99.7, 999.4, 999.7, 1234.5, -999.9, 99999.6, 123456.7])
@pytest.mark.parametrize("places", [2, 3, 4])
def test_below_a_million_a_number_is_plain_and_right_to_its_digits(value: float, places: int) -> None:
    text = digits(value, places)
    assert "e" not in text
    assert float(text) == pytest.approx(value, rel=0.5 * 10.0 ** (1 - places))


def test_whole_digits_stand_and_large_numbers_are_powers() -> None:
    assert (digits(999.7), digits(99.7, 2), digits(12345.6), digits(2.5e7)) == ("1000", "100", "12346", "2.5e+07")
    assert digits(float("nan")) == "nan"
