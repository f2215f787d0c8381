"""Guided multiple-model search (Sections III and IV of the paper). NumPy only."""
