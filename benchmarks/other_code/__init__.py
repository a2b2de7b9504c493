"""Tests of another finite-element code (felupe) with laws of their own, written as exports of a DIC program and diagnosed on defaults."""
