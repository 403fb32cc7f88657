"""Standardised, fold-free 2D maps of the left atrium."""
