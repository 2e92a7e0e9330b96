"""What came of trying to realise a column: a setting, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass

from errors.telling import probability_text
from planner.setting.sensor_setting import SensorSetting


@dataclass(frozen=True)
class Outcome:
    """What a run for a set of entities found.

    Attributes
    ----------
    setting : SensorSetting or None
        The setting; it may miss the required probability for some of the entities.
    reason : str
        Why there is none; empty if there is one.
    """

    setting: SensorSetting | None = None
    reason: str = ""

    def reason_at(self, threshold: float) -> str:
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
            return (
                f"no feasible view: the best pose found reaches P = {probability_text(best)}, but breaks a constraint "
                "when judged anew."
            )
        # so many digits that it is seen to be below
        digits = next((n for n in range(4, 16) if round(best, n) < threshold), 16)
        return (
            f"probability too low: the best pose found reaches P = {best:.{digits}f}, "
            f"below the required {threshold:g}."
        )
