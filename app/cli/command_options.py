"""How a function becomes a command of `slipscope`, and the options that several commands have.

A parameter that is a section of settings becomes one option per setting: names, defaults, units,
limits and help come from their declaration, and the command receives the section, checked.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

import typer
from typer import Argument, Option, Typer
from typer.core import TyperCommand, TyperGroup

from analysis.options import Section, number_in, options
from app.cli import completion
from app.settings.sections import flag
from app.system.errors import UserError

F = TypeVar("F", bound=Callable[..., int])
_KEYWORD = inspect.Parameter.KEYWORD_ONLY


def option_of(choices: str, *names: str, meaning: str) -> Any:
    """An option with these choices, ``"fast|accurate"``; those in capitals stand for others."""
    offered = completion.words(*re.findall(r"[a-z\d]+", choices))
    return Option(*names, metavar=choices, help=meaning, autocompletion=offered)


JsonFlag = Annotated[
    bool,
    Option(
        "--json",
        help="Print one JSON document (SI units, named in the keys), also for errors.",
    ),
]
Headless = Annotated[
    bool,
    Option(
        "--headless",
        help="No window; show a progress bar in the terminal. The default without a display.",
    ),
]
Overrides = Annotated[
    list[str] | None,
    Option(
        "--set",
        metavar="TABLE.KEY=VALUE",
        help="Change one setting of the file; may be repeated.",
        autocompletion=completion.settings,
    ),
]
Pace = Annotated[
    str,
    option_of(
        "1|max|NUMBER",
        meaning="Simulated seconds per second; max: as fast as possible. A real bench runs at 1.",
    ),
]
Overwrite = Annotated[
    bool,
    Option("--overwrite", help="Replace existing output files. Without it they are never changed."),
]
Bench = Annotated[
    Path | None,
    Argument(
        metavar="[BENCH.toml]",
        help="Settings file, see `slipscope config`; or hil-emulated, slide-hold-slide,"
        " cyclic-shear. Default: the simulated bench.",
        autocompletion=completion.files(".toml", benches=True),
    ),
]
SessionFile = Annotated[
    Path,
    Argument(
        metavar="SESSION.h5",
        help="A session written by `slipscope run`.",
        autocompletion=completion.files(".h5"),
    ),
]

ALSO = {"modulus": ("--E",)}  # further names of options
PANELS = {  # groups of commands in the help, in order
    "Experiments": ("run", "campaign", "attach", "stop", "answer", "pause", "note"),
    "Sessions": ("replay", "info", "export", "import", "repair"),
    "Analysis": ("analyze", "figures", "sweep", "dic", "invert", "model", "tradeoff"),
    "Bench": ("config", "setup", "check", "calibrate", "cameras"),
    "Maintenance": ("doctor", "menu-entry", "trust", "check-driver"),
}
PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names}
COMPUTING = ("Sessions", "Analysis")  # whose commands move nothing: Ctrl-C may cut them short
TYPED = "typed"  # each parameter as it was typed, in the context of a command
METHOD = "Method"  # group of the options of a section in the help of a command
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

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the command line, whose numbers are those that `number_in` reads."""
        texts, *_ = self.make_parser(ctx).parse_args([*args])
        words = {word.partition("=")[0] for word in args}
        typed = ctx.meta[TYPED] = {
            parameter.name: next(
                (name for name in parameter.opts if name in words), parameter.opts[0]
            )
            for parameter in self.get_params(ctx)
        }
        rest: list[str] = super().parse_args(ctx, args)
        with plain_errors(ctx.params.get("as_json", False)):
            for parameter in self.get_params(ctx):
                given, value = texts.get(parameter.name, ()), ctx.params.get(parameter.name)
                values = value if isinstance(value, list | tuple) else [value]
                if not {int, float}.isdisjoint(map(type, values)):
                    for text in [given] if isinstance(given, str) else given:
                        if not _is_finite(text):
                            raise UserError(
                                f"{typed[parameter.name]}: a finite number is needed; found {text}"
                            )
        return rest


def _is_finite(text: str) -> bool:
    try:
        return math.isfinite(number_in(text))
    except ValueError:
        return False


class Program(_PlainFlags, TyperGroup):
    """The program, whose commands are shown in groups."""

    def list_commands(self, ctx: Any) -> list[str]:
        """All names, by group."""
        return sorted(super().list_commands(ctx), key=[*PANEL_OF].index)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of this name, if there is one, in its group."""
        found: Any = super().get_command(ctx, cmd_name)
        if found:
            found.rich_help_panel = PANEL_OF[cmd_name]
        return found


class Calibrations(TyperGroup):
    """The commands of all calibrations, which are imported when one is asked for."""

    @cached_property
    def commands(self) -> dict[str, Any]:  # type: ignore[override]
        """By name."""
        from app.cli.calibrate import app

        found: dict[str, Any] = vars(typer.main.get_command(app))["commands"]
        return found

    def __init__(self, **group: Any) -> None:
        super().__init__(**group)
        del self.commands  # those of the group itself, which has none


@dataclass(frozen=True, slots=True)
class Given:
    """Marks a parameter that receives the settings of a section that were given, as a dict of SI
    values by name, and not the whole section; its help has the defaults where `has_defaults`.
    """

    section: type[Section]
    has_defaults: bool = False


def output_file(metavar: str, meaning: str) -> Any:
    """The option for the file that a command writes."""
    return Option("-o", "--output", metavar=metavar, help=meaning)


def command(app: Typer) -> Callable[[F], F]:
    """Make a function the command of its name: its docstring is the help, what it returns is the
    exit code, and every error is one sentence.
    """

    def add(function: F) -> F:
        parameters = [inspect.Parameter("context", _KEYWORD, annotation=typer.Context)]
        sections: dict[str, Any] = {}  # parameter -> section or `Given`
        for name, parameter in inspect.signature(function, eval_str=True).parameters.items():
            kind = parameter.annotation
            for declared in getattr(kind, "__metadata__", ()):
                if hasattr(declared, "readable"):  # who reads a file says why it cannot
                    declared.readable = False
            kind = next((a for a in get_args(kind) if isinstance(a, Given)), kind)
            if isinstance(kind, Given) or (get_origin(kind) is None and issubclass(kind, Section)):
                sections[name] = kind
                parameters += _parameters(kind)
            else:
                parameters.append(parameter.replace(kind=_KEYWORD))

        def call(context: typer.Context, **values: Any) -> None:
            as_json = values.get("as_json", False)
            computes = PANEL_OF.get(context.info_name or "") in COMPUTING
            with plain_errors(as_json, computes):
                for name, kind in sections.items():
                    values[name] = _taken(kind, context, values)
                raise typer.Exit(function(**values))

        call.__doc__ = function.__doc__
        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        app.command(function.__name__.strip("_").replace("_", "-"), cls=_Command)(call)
        return function

    return add


def _parameters(kind: type[Section] | Given) -> Iterator[inspect.Parameter]:
    """One option of the command line for each setting of a section; of texts, one each time that
    it is given.
    """
    is_partial = isinstance(kind, Given) and not kind.has_defaults
    for declared in options(kind.section if isinstance(kind, Given) else kind).values():
        type_: Any = list[str] if declared.type == tuple[str, ...] else declared.type
        limits = f" ({declared.limits})" if declared.limits and not declared.choices else ""
        option = Option(
            flag(declared.name),
            *ALSO.get(declared.name, ()),
            metavar="|".join(declared.choices) or declared.unit or None,
            autocompletion=completion.words(*declared.choices) if declared.choices else None,
            help=f"{declared.meaning}{limits}.",
            rich_help_panel=METHOD,
        )
        yield inspect.Parameter(
            declared.name,
            _KEYWORD,
            default=None if is_partial else declared.default,
            annotation=Annotated[type_ | None if is_partial else type_, option],
        )


def _taken(kind: type[Section] | Given, context: typer.Context, values: dict[str, Any]) -> Any:
    """The section of the options that the command line gave, which are taken from `values`, or what
    was given of it: a preset must tell them from defaults.
    """
    from app.settings.config import section_from

    section = kind.section if isinstance(kind, Given) else kind
    options_of = {name: values.pop(name) for name in options(section)}
    given = {
        name: value
        for name, value in options_of.items()
        if getattr(context.get_parameter_source(name), "name", "") != "DEFAULT"
    }
    read = section_from(section, given, context.meta[TYPED].__getitem__)
    return {name: getattr(read, name) for name in given} if isinstance(kind, Given) else read


def plain_errors(as_json: bool = False, computes: bool = False) -> Any:
    """Every error as one sentence and an exit code, or, after `slipscope --debug`, as it is."""
    from app.cli import terminal

    return terminal.plain_errors(as_json, is_debugging, computes)
