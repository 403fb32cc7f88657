"""Solvers that bring the cavity into the plane."""
