"""Row solvers whose tick is compiled: extra ``fast``."""
