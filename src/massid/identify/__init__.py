"""Offline and online identification from walks."""
