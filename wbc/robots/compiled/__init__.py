"""Kernels of the estimate of a base."""
