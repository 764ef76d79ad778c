"""How a function becomes a command of `slipscope`, and the options that several commands have.

A parameter that is a section of settings becomes one option per setting: names, defaults, units,
limits and help come from their declaration, and the command receives the section, checked.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from analysis.options import Option, Section, options
from app.settings.sections import flag

JsonFlag = Annotated[
    bool,
    typer.Option(
        "--json",
        help="One JSON document on standard output (SI units, named in the keys), also for errors.",
    ),
]
Headless = Annotated[
    bool,
    typer.Option(
        "--headless",
        help="No window: a progress bar in the terminal. Chosen by itself without a display.",
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="TABLE.KEY=VALUE",
        help="One setting, which replaces that of the file; may be repeated.",
    ),
]
Pace = Annotated[
    str,
    typer.Option(
        metavar="1|max|NUMBER",
        help="Simulated seconds per second; max: as fast as possible. A real bench runs at 1.",
    ),
]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite", help="Replace output files that exist. Without it they are never touched."
    ),
]
Bench = Annotated[
    Path | None,
    typer.Argument(
        metavar="[BENCH.toml]",
        help="Settings, see `slipscope config`; or hil-emulated, slide-hold-slide, cyclic-shear."
        " Else the simulated bench.",
    ),
]
SessionFile = Annotated[
    Path, typer.Argument(metavar="SESSION.h5", help="A session that `slipscope run` wrote.")
]

ALSO = {"modulus": ("--E",)}  # further names of options
is_debugging = False  # set by `slipscope --debug`; one process runs one command line


class _PlainFlags:
    """Whose help names no type after an option that takes no value."""

    def get_params(self, ctx: Any) -> list[Any]:
        """All parameters."""
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if getattr(parameter, "is_flag", False) and parameter.metavar is None:
                parameter.metavar = ""
        return parameters


class _Command(_PlainFlags, TyperCommand):
    """A command of the program."""


class Program(_PlainFlags, TyperGroup):
    """The program."""


@dataclass(frozen=True, slots=True)
class Given:
    """Marks a parameter that receives the settings of a section that were given, as a dict of SI
    values by name, and not the whole section.
    """

    section: type[Section]


def output(metavar: str, meaning: str) -> Any:
    """The option for the file that a command writes."""
    return typer.Option("-o", "--output", metavar=metavar, help=meaning)


def command(app: typer.Typer, name: str | None = None) -> Callable[[Callable[..., int]], None]:
    """Make a function a command: its docstring is the help, what it returns is the exit code, and
    every error is one sentence.
    """

    def add(function: Callable[..., int]) -> None:
        hints = get_type_hints(function, include_extras=True)
        defaults = inspect.signature(function).parameters
        sections: dict[str, Any] = {}  # parameter -> section or `Given`
        parameters = []
        for parameter, hint in hints.items():
            if parameter == "return":
                continue
            kind = next((a for a in get_args(hint) if isinstance(a, Given)), hint)
            if isinstance(kind, Given) or (get_origin(kind) is None and issubclass(kind, Section)):
                sections[parameter] = kind
                parameters += _parameters(kind)
            else:
                parameters.append(_parameter(parameter, hint, defaults[parameter].default))

        def call(context: typer.Context, **values: Any) -> None:
            with plain_errors(values.get("as_json", False)):
                own = {name: values.pop(name) for name in hints if name in values}
                for parameter, kind in sections.items():
                    own[parameter] = _read(kind, _given(context, values))
                raise typer.Exit(function(**own))

        call.__doc__ = function.__doc__
        parameters.insert(0, _parameter("context", typer.Context, inspect.Parameter.empty))
        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        call.__annotations__ = {p.name: p.annotation for p in parameters}
        app.command(name or function.__name__, cls=_Command)(call)

    return add


def _parameter(name: str, hint: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)


def _parameters(kind: type[Section] | Given) -> list[inspect.Parameter]:
    """One option of the command line for each setting of a section."""
    if isinstance(kind, Given):
        declared = options(kind.section).values()
        return [_parameter(o.name, _option(o, _type(o) | None), None) for o in declared]
    return [_parameter(o.name, _option(o, _type(o)), o.default) for o in options(kind).values()]


def _type(declared: Option) -> Any:
    """What the command line takes for a setting; of texts, one each time that it is given."""
    return list[str] if declared.type == tuple[str, ...] else declared.type


def _option(declared: Option, kind: Any) -> Any:
    """The annotation of a parameter, from the declaration of a setting."""
    limits = f" ({declared.limits})" if declared.limits and not declared.choices else ""
    option = typer.Option(
        flag(declared.name),
        *ALSO.get(declared.name, ()),
        metavar="|".join(declared.choices) or declared.unit or None,
        help=f"{declared.meaning}{limits}.",
    )
    return Annotated[kind, option]


def _given(context: typer.Context, values: dict[str, Any]) -> dict[str, Any]:
    """The options that the command line gave: a preset must tell them from defaults."""
    source = context.get_parameter_source
    return {name: x for name, x in values.items() if getattr(source(name), "name", "") != "DEFAULT"}


def _read(kind: type[Section] | Given, values: dict[str, Any]) -> Any:
    """The section from what the command line gave, or what was given of it."""
    from app.settings.config import section_from

    section = kind.section if isinstance(kind, Given) else kind
    given = {name: values[name] for name in options(section) if name in values}
    read = section_from(section, given, flag)
    return {name: getattr(read, name) for name in given} if isinstance(kind, Given) else read


def plain_errors(as_json: bool = False) -> Any:
    """Every error as one sentence and an exit code, or, after `slipscope --debug`, as it is."""
    from app.cli import terminal

    return terminal.plain_errors(as_json, is_debugging)
