"""Fits to stress-stretch curves of homogeneous tests."""
