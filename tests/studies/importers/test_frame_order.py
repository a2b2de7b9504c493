"""Order of frames by their names: by time, by the number that differs, refused where numbers disagree."""

from __future__ import annotations

import pytest

from calibrate import errors
from studies.importers.exports.frame_order import frame_order


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["img_10", "img_9", "img_100"], ["img_9", "img_10", "img_100"]),
        (["a 1_21.555 s", "a 1_3.5 s", "a 1_21.25 s"], ["a 1_3.5 s", "a 1_21.25 s", "a 1_21.555 s"]),
        (["a_2,5s", "a_10,0s"], ["a_2,5s", "a_10,0s"]),
        (["f7_2_0", "f7_10_0"], ["f7_2_0", "f7_10_0"]),  # only one number differs
        (["2_20", "1_10"], ["1_10", "2_20"]),  # two that agree
        (["load2", "reference", "load1"], ["reference", "load1", "load2"]),
    ],
)
def test_order(names, expected):
    assert [names[i] for i in frame_order(names).index] == expected


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["t1_2", "t2_1", "t3_5"], "give different orders"),
        (["a1", "b2"], "named unlike"),
        (["a_1", "a_01"], "the same numbers"),
        (["rest", "reference", "a1"], "have no number"),
    ],
)
def test_ambiguous_order_is_refused(names, message):
    with pytest.raises(errors.UndecidedError, match=message):
        frame_order(names)


def test_natural_order_may_be_chosen():
    names = ["t2_1", "t1_10", "t1_2"]
    assert [names[i] for i in frame_order(names, "natural").index] == ["t1_2", "t1_10", "t2_1"]


def test_a_reference_without_a_number_leaves_the_others_theirs():
    order = frame_order(["img_0010", "reference", "img_0005", "img_0020"])
    assert order.index == (1, 2, 0, 3) and order.values.tolist() == [5.0, 10.0, 20.0]
