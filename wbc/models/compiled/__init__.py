"""Kernels about robots."""
