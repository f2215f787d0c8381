"""Identification models: output injection and the parallel bank (Eq. 3 and 23)."""
