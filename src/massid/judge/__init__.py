"""Judgement: what a log can reveal before anything is fitted, and whether what was found is right."""
