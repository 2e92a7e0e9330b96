"""What came of trying to realise a column: a setting, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass

from errors.formatting import probability_text
from planner.setting.reason import Reason, ReasonKind
from planner.setting.sensor_setting import SensorSetting

_NONE = Reason("")


@dataclass(frozen=True)
class Outcome:
    """What a run for a set of entities found.

    Attributes
    ----------
    setting : SensorSetting or None
        The setting; it may miss the required probability for some of the entities.
    reason : Reason
        Why there is none, with its kind; empty if there is one.
    """

    setting: SensorSetting | None = None
    reason: Reason = _NONE

    def reason_at(self, threshold: float) -> Reason:
        """Say why an entity is not inspected, given that this is the outcome of its own run.

        Parameters
        ----------
        threshold : float
            Required probability.
        """
        if self.setting is None:
            return self.reason
        best = max(self.setting.probability.values())
        if best >= threshold:
            return Reason.of(
                ReasonKind.NO_FEASIBLE_VIEW,
                f"the best pose found reaches P = {probability_text(best)}, "
                "but violates a constraint when checked again.",
            )
        # so many digits that it is seen to be below
        digits = next((n for n in range(4, 16) if round(best, n) < threshold), 16)
        return Reason.of(
            ReasonKind.PROBABILITY_TOO_LOW,
            f"the best pose found reaches P = {best:.{digits}f}, below the required {threshold:g}.",
        )
