"""Kernels of a controller."""
