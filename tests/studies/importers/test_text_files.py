"""How a text table is written is found from its content."""

from __future__ import annotations

import numpy as np
import pytest

from calibrate import errors
from studies.importers.exports.text_files import text_file
from studies.importers.text_tables import read_table
from studies.importers.vendors import vendors


@pytest.mark.parametrize(
    ("text", "encoding", "expected", "values"),
    [
        ("x;y;u\n1,5;2;3\n-1,5e-3;2;3\n", "utf-8-sig", (";", ",", 1, ("x", "y", "u")), [1.5, -1.5e-3]),
        ("x\ty\tu\n1.5\t2\t3\n4\t5\t6\n", "utf-16", ("\t", ".", 1, ("x", "y", "u")), [1.5, 4]),
        ("Länge [mm];u\n1;2\n3;4\n", "latin-1", (";", ".", 1, ("Länge [mm]", "u")), [1, 3]),
        ('"x", "y", "u"\n 1.5, 2, 3\n 4, NaN, 6\n', "utf-8", (",", ".", 1, ("x", "y", "u")), [1.5, 4]),
        ("  x   y   u\n  1.5  2  3\n  4  5  6\n", "utf-8", (" ", ".", 1, ("x", "y", "u")), [1.5, 4]),
        ("Test 7\nDate;12.3.2024\nx;y;u\n(mm);(mm);(mm)\n1,5;2;3\n4;5;6\n", "utf-8", (";", ",", 3, ("x", "y", "u")), [1.5, 4]),
        ("x;y;u\n1,5;Non un numero reale;3\nn. def.;2,5;3\n", "utf-8", (";", ",", 1, ("x", "y", "u")), [1.5, np.nan]),
        ("1,5;2;3;\n4;5;6;\n", "utf-8", (";", ",", 0, ()), [1.5, 4]),
    ],
)  # fmt: skip
def test_layout_of_a_table(tmp_path, text, encoding, expected, values):
    path = tmp_path / "t.csv"
    path.write_text(text, encoding=encoding)
    file = text_file(path)
    assert (file.delimiter, file.decimal, file.header_line, file.names) == expected
    assert file.rows == 2
    name = file.names[0] if file.names else "1"
    np.testing.assert_array_equal(read_table(path, [name], file.layout)[name], values)


def test_what_is_no_table(tmp_path):
    for k, raw in enumerate((b"", b"Dear reader,\nno numbers here.\n", b"\x89PNG\0\0\0\x01\x02")):
        path = tmp_path / f"{k}.txt"
        path.write_bytes(raw)
        assert text_file(path) is None


def test_an_unknown_word_for_a_missing_value_is_named(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("x;y\n1;2\n3;kaputt\n")
    with pytest.raises(errors.FileFormatError, match=r"line 3: 'kaputt' in 'y'.*missing_words"):
        read_table(path, ["y"], text_file(path).layout)


@pytest.mark.parametrize(
    ("header", "program"),
    [
        ("X,Y,Z,U,V,W,exx,eyy,exy,e1,e2,gamma,sigma,x,y,u,v,q,r,q_ref,r_ref", "VIC-2D, VIC-3D"),
        ('"X [mm]","Y [mm]","Z [mm]","U [mm]","V [mm]","W [mm]","exx [1] - Lagrange"', "VIC-2D, VIC-3D"),
        ("x,y,u,v,sigma,x_c,y_c,u_c,v_c,exx,eyy,exy,e1,e2,gamma", "VIC-2D, VIC-3D"),
        ("x_pic,y_pic,x,y,z,u,v,w,exx", "MatchID (tables)"),
        ("Coordinates.Image X [Pixel],Coordinates.Image Y [Pixel],disp.Horizontal Displacement U [Pixel],disp.Vertical Displacement V [Pixel]", "MatchID (tables)"),
        ("coor.X [mm],coor.Y [mm],coor.Z [mm],disp.Horizontal Displacement U [mm],disp.Vertical Displacement V [mm],disp.Out-Of-Plane: W [mm]", "MatchID (tables)"),
        ("ID,x_undef [mm],y_undef [mm],z_undef [mm],u [mm],v [mm],w [mm],epsx [%]", "ZEISS/GOM Correlate"),
        ("SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,GAMMA,BETA,STATUS_FLAG,UNCERTAINTY", "DICe"),
        ("x,y,u0,v0,u,v,exx,eyy,exy,zncc,iteration,convergence,feature", "OpenCorr"),
        ("d,x,y,ux,uy", "muDIC"),
        ("FRAME,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA", None),  # one subset over all frames
        ("Time,Force,Displacement", None),
        ("x,y,u,v", None),
    ],
)  # fmt: skip
def test_one_program_at_most_knows_a_header(tmp_path, header, program):
    """Column names of public scripts and manuals."""
    path = tmp_path / "frame_1.csv"
    width = header.count(",") + 1
    path.write_text("\n".join([header, *(",".join(str(k + c) for c in range(width)) for k in range(4))]) + "\n")
    file = text_file(path)
    assert [vendor.name for vendor in vendors() if vendor.claims(file)] == ([program] if program else [])
