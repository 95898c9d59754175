"""Kernels of the levels."""
