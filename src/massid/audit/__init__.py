"""Does this log make sense for this robot? Weight, gravity, position against velocity, lag, self-contact, residuals."""

from massid.audit.prepare import Prepared, prepare_walk, prepare_walks
from massid.audit.report import Audit, audit_walk
from massid.audit.same_robot import differing_masses

__all__ = ["Audit", "Prepared", "audit_walk", "differing_masses", "prepare_walk", "prepare_walks"]
