"""Errors that hold as data which parameter breaks which rule with what value, and state it in one line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing import Self


class RuleError(Exception):
    """Base of the errors of each package.

    Attributes
    ----------
    parameter : str
        The parameter that breaks its rule; empty if there is none.
    rule : str
        The rule, beginning with its verb; a whole sentence without a parameter.
    got : str
        The value that breaks it.
    hint : str
        Advice, without a full stop.
    mentions : tuple of str
        Other parameters in `rule` and `hint`, in the form used there: ``gap_mm`` or ``gap_mm=0.1``.
    """

    parameter: str = ""
    rule: str = ""
    got: str = ""
    hint: str = ""
    mentions: tuple[str, ...] = ()

    @classmethod
    def of_rule(
        cls,
        parameter: str,
        rule: str,
        got: str,
        *,
        hint: str = "",
        mentions: tuple[str, ...] = (),
    ) -> Self:
        """Return the error of a broken rule: "PARAMETER RULE. Got GOT; HINT.".

        Parameters
        ----------
        parameter, rule, got, hint : str
            See the attributes.
        mentions : tuple of str
            See the attributes.

        Returns
        -------
        RuleError
            Of this class.
        """
        error = cls(f"{parameter} {rule}. Got {got}.".lstrip())
        vars(error).update(parameter=parameter, rule=rule, got=got, hint=hint, mentions=mentions)
        return error

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep data and class where Dask pickles an error that is two builtins at once."""
        return type(self), self.args, dict(vars(self))

    def __str__(self) -> str:
        """Return the text, with the hint behind it: a sentence of its own if it begins like one."""
        text = super().__str__()
        if not self.hint:
            return text
        hint = self.hint if self.hint.endswith("?") else f"{self.hint}."
        if hint[0].isupper():
            return f"{text} {hint}"
        return f"{text.removesuffix('.')}; {hint}"
