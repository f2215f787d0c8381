"""What to compare an identification with: the method that others use, and the bound that no method can beat."""

from massid.compare.cramer_rao import Bound, cramer_rao
from massid.compare.least_squares import CUTOFFS_HZ, Fit, fit_masses, scan_cutoffs, self_chosen

__all__ = ["CUTOFFS_HZ", "Bound", "Fit", "cramer_rao", "fit_masses", "scan_cutoffs", "self_chosen"]
