"""Which body, lens, working distance and aperture of the catalogue can measure what is wanted, and how well."""

from planner.optics.proposal import OpticsProposal, optics_table
from planner.optics.propose import propose_optics

__all__ = ["OpticsProposal", "optics_table", "propose_optics"]
