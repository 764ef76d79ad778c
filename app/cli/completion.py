"""What a shell offers for a value after TAB: benches, settings, files, words.

A shell starts the program for it: nothing heavy is imported, and no file is opened.
"""

from __future__ import annotations

import os
from collections.abc import Callable

Offered = list[tuple[str, str]]  # words with their meaning, which some shells show


def words(*known: str) -> Callable[[str], Offered]:
    """Some words."""
    return lambda incomplete: [(word, "") for word in dict.fromkeys(known)]


def files(
    *endings: str, benches: bool = False, campaigns: bool = False
) -> Callable[[str], Offered]:
    """Names of benches and campaigns that come with the program, and files with these endings in
    the folder that was written so far. Where there are none, the shell completes folders by itself.
    """

    def offered(incomplete: str) -> Offered:
        folder = os.path.split(incomplete)[0]
        try:
            found = sorted(os.listdir(folder or os.curdir))
        except OSError:
            found = []
        own: list[str] = []
        if (benches or campaigns) and not folder:
            from app.settings import config

            own += config.bench_names() if benches else ()
            own += config.campaign_names() if campaigns else ()
        # the shell would take a name with a space for two words
        there = [name for name in found if name.endswith(endings) and len(name.split()) == 1]
        return [(name, "") for name in [*own, *(os.path.join(folder, name) for name in there)]]

    return offered


def settings(incomplete: str) -> Offered:
    """``table.key=`` of every setting; with its values, if it is the only one and has choices."""
    from analysis.options import options
    from app.settings.config import sources, tables

    key = incomplete.partition("=")[0]
    found = {
        name: declared
        for table, section in tables().items()
        for word, declared in options(section).items()
        if (name := f"{table}.{word}").startswith(key)
    }
    if incomplete != key:
        found = {name: declared for name, declared in found.items() if name == key}
    if len(found) != 1:
        return [(f"{name}=", declared.meaning) for name, declared in found.items()]
    ((name, declared),) = found.items()
    table, _, word = name.partition(".")
    values = [*sources().get(table, ())] if word == "source" else list(declared.choices)
    values = values or ["true", "false"] * (declared.type is bool)
    return [(f"{name}={value}", declared.meaning) for value in values or [""]]


def figures(incomplete: str) -> Offered:
    """The figures of the paper and those beside them."""
    from app.report.paper.titles import TITLES

    return list(TITLES.items())
