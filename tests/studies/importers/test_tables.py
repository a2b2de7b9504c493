"""Text tables: layouts, and bad input named by file and line."""

from __future__ import annotations

import numpy as np
import pytest
from sheets import write

from calibrate import errors
from studies.importers.text_tables import Layout, read_table


def test_table_by_names_with_units_comments_and_quotes(tmp_path):
    text = '# made by hand\n"Time","Force (N)"\r\n(s),(N)\r\n"0.5","1.25"\r\n\r\n"1.0","2.5e0"\r\n'
    path = write(tmp_path / "t.csv", text)
    table = read_table(path, ["Force (N)"], Layout(units_row=True, comment="#"))
    assert table["Force (N)"].tolist() == [1.25, 2.5]


def test_table_without_header_blank_separated(tmp_path):
    table = read_table(write(tmp_path / "t.txt", "  0.1   1.0\n 0.2  1.5\n"), None, Layout(" ", header_line=0))
    assert table["1"].tolist() == [0.1, 0.2]
    assert table["2"].tolist() == [1.0, 1.5]


def test_table_in_latin_1(tmp_path):
    path = write(tmp_path / "t.csv", "Weg [µm];Kraft\n1;2\n", "latin-1")
    assert read_table(path, None, Layout(";"))["Weg [µm]"].tolist() == [1.0]


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        (
            "a;b\n1;2\n3\n",
            errors.FileFormatError,
            "line 3: 1 fields where the header has 2; is the file truncated",
        ),
        ("a;b\n1;2\n3;\n", errors.FileFormatError, "line 3: no value in 'b'"),
        ("a;b\n1;2\n\n3;x7\n", errors.FileFormatError, "line 4: 'x7' in 'b' is not a number"),
        ("a;b\n1;2\n3;4;5\n", errors.FileFormatError, "line 3: 3 fields"),
        ("a;b\n1;0,5\n", errors.DecimalCommaError, "line 2: '0,5' in 'b' has a decimal comma"),
        ("a;b\n1;inf\n", errors.FileFormatError, "line 2: 'b' is not a finite number"),
        ("a;b\n", errors.FileFormatError, "no rows of numbers"),
        ("", errors.FileFormatError, "empty or truncated"),
        ("a;c\n1;2\n", errors.FileFormatError, "no column named 'b'"),
        ("a,b\n1,2\n", errors.FileFormatError, "is the delimiter right"),
    ],
)
def test_bad_tables_name_file_and_line(tmp_path, text, kind, message):
    path = write(tmp_path / "bad.csv", text)
    with pytest.raises(kind, match=message) as caught:
        read_table(path, ["a", "b"], Layout(";"))
    assert "bad.csv" in str(caught.value)


def test_decimal_commas_between_commas(tmp_path):
    with pytest.raises(errors.DecimalCommaError, match="line 2"):
        read_table(write(tmp_path / "t.csv", "a,b\n0,5,1,25\n"), ["a", "b"])
    with pytest.raises(errors.DecimalCommaError, match="line 2"):
        read_table(write(tmp_path / "t.csv", 'a,b\n"0,5","1,25"\n'), ["a", "b"])


def test_missing_values_where_allowed(tmp_path):
    table = read_table(write(tmp_path / "t.csv", "a,b\n1,NaN\n2,\n"), None, Layout(missing_allowed=True))
    assert np.isnan(table["b"]).all()
    with pytest.raises(errors.DataNotFoundError, match="no such file"):
        read_table(tmp_path / "nothing.csv")
