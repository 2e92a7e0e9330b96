"""Code of compiled functions that only other compiled functions call: kept as instructions of LLVM, to be linked.

Numba makes machine code of every function when it has compiled it, though a caller that is compiled takes the
function's instructions in, optimises them once more together with its own, and makes machine code of both. Where calls
are nested deeply, most of the work is done many times over. This leaves it to those functions that Python calls.
Numba's own functions, such as `numpy.empty`, are compiled once for callers of both kinds, and not for each.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import Compiler, CompileResult, Flags
from numba.core.environment import lookup_environment

# how numba names the global variable that points to what a function knows of its module
_ENVIRONMENT = "_ZN08NumbaEnv"

# what this module takes from numba without a promise: names in classes, or that their constructors set
_NAMES: tuple[tuple[type, tuple[str, ...]], ...] = (
    (
        JITCodeLibrary,
        (
            "codegen",
            "enable_object_caching",
            "get_pointer_to_function",
            "serialize_using_bitcode",
            "serialize_using_object_code",
            "_codegen",
            "_final_module",
            "_finalize_dynamic_globals",
            "_finalize_final_module",
            "_finalize_specific",
            "_finalized",
            "_optimize_final_module",
            "_verify_declare_only_symbols",
        ),
    ),
    (JITCPUCodegen, ("set_env",)),
    (Compiler, ("define_pipelines", "flags", "func_id", "library", "state", "targetctx")),
    (Flags, ("options", "_values")),
)


def has_all_names() -> bool:
    """Return whether numba has all that this module takes from it; otherwise nothing here may be used."""
    named = all(_has(kind, name) for kind, names in _NAMES for name in names)
    # the function of numba that looks for these variables says what they are called
    finder = getattr(CompileResult, "_find_referenced_environments", None)
    code = getattr(finder, "__code__", None)
    return named and code is not None and _ENVIRONMENT in code.co_consts


def _has(kind: type, name: str) -> bool:
    """Return whether a class has a name, or a constructor of it, or of one it is made from, sets it."""
    constructors = [vars(base).get("__init__") for base in kind.__mro__]
    codes = [getattr(constructor, "__code__", None) for constructor in constructors]
    return hasattr(kind, name) or any(name in code.co_names for code in codes if code is not None)


class _Linked(JITCodeLibrary):
    """Instructions that never become machine code by themselves."""

    @property
    def codegen(self) -> Any:
        return _WithoutAddresses(self._codegen)

    def _optimize_final_module(self) -> None:
        """Leave it to the callers, which do it with what they inline."""

    def _finalize_final_module(self) -> None:
        library: Any = self
        library._finalize_dynamic_globals()
        library._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, which numba takes as a function that Python cannot call."""
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return what is kept in the cache; there is no object code."""
        return self.serialize_using_bitcode()  # type: ignore[no-untyped-call]


class _WithoutAddresses:
    """The code generator, for code that has no address yet at which a variable could be set."""

    def __init__(self, generator: Any) -> None:
        self._generator = generator

    def __getattr__(self, name: str) -> Any:
        return getattr(self._generator, name)

    def set_env(self, name: str, environment: object) -> None:
        """Leave it to those that link the code."""


class _Entry(JITCodeLibrary):
    """Machine code; sets the environments of functions that were linked into it, too."""

    def _finalize_specific(self) -> None:
        super()._finalize_specific()  # type: ignore[no-untyped-call]
        generator: Any = self._codegen
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                environment = lookup_environment(variable.name)  # type: ignore[no-untyped-call]
                if environment is not None:
                    generator.set_env(variable.name, environment)


# how a function is entered, which those it calls do not depend on
_ENTERING = ("no_cpython_wrapper", "no_cfunc_wrapper", "release_gil")


class _Flags(Flags):
    """Options of a function, to numba the key under which it finds what the function calls.

    Those of how it is entered do not count, nor those that are as by default: numba compares all of them, so often that
    it takes a twentieth of the time of compiling.
    """

    def _counting(self) -> dict[str, Any]:
        options: Any = self.options  # type: ignore[attr-defined]
        return {
            name: value
            for name, value in self._values.items()
            if name not in _ENTERING and value != options[name].default
        }

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Flags) and self._counting() == other._counting()

    def __hash__(self) -> int:
        return hash(frozenset(self._counting()))


class _WithLibrary(Compiler):
    """A compiler that puts its code into a library of a kind of its own."""

    _kind: type[JITCodeLibrary]

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)  # type: ignore[no-untyped-call]
        self.state.flags = _Flags(self.state.flags)  # type: ignore[no-untyped-call]

    def define_pipelines(self) -> Any:
        state = self.state
        if state.library is None:
            name = getattr(state.func_id, "func_qualname", "loop")
            state.library = self._kind(state.targetctx.codegen(), name)
            # as numba does, so that it can be cached
            state.library.enable_object_caching()
        return super().define_pipelines()  # type: ignore[no-untyped-call]


class LinkedCompiler(_WithLibrary):
    """For functions that only compiled functions call."""

    _kind = _Linked


class EntryCompiler(_WithLibrary):
    """For functions that Python calls, and that call such functions."""

    _kind = _Entry
