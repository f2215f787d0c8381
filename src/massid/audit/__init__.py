"""Does this log make sense for this robot? Weight, gravity, position against velocity, lag, self-contact, residuals."""

from massid.audit.prepare import Prepared, prepare_walk, prepare_walks
from massid.audit.report import Audit, audit_walk

__all__ = ["Audit", "Prepared", "audit_walk", "prepare_walk", "prepare_walks"]
