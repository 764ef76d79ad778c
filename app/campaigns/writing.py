"""Writes the file of a campaign: one set of settings, over loads, velocities, samples, repeats."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from app.campaigns.plan import Campaign, read_campaign
from app.settings.config import to_toml
from app.settings.plain_values import toml_text
from app.settings.sections import Config
from app.system.outputs import new_file

TABLE = re.compile(r"^(\[\[?)(?=\w)", re.MULTILINE)
SESSIONS = "{name}-{number}-{load:g}N"


def write_campaign(
    path: Path,
    config: Config,
    vary: Mapping[str, Sequence[float | str]],
    *,
    repeats: int,
    pauses: bool,
) -> Campaign:
    """Write the campaign of these settings, and read it again.

    Parameters
    ----------
    vary : mapping
        ``table.key`` -> its values, as in a settings file; the last one changes fastest.
    pauses : bool
        Whether the operator is waited for before each run.

    Raises
    ------
    UserError
        It plans what cannot be run, or the file cannot be written; there is none then.
    """
    lists = [f"{key} = {toml_text(list(values))}" for key, values in vary.items() if values]
    lines = [
        f"name = {toml_text(path.stem)}",
        f"sessions = {toml_text(SESSIONS)}",
        f"repeats = {repeats}",
        f"pauses = {toml_text(pauses)}",
        "",
        "[vary]",
        *lists,
        "",
        TABLE.sub(r"\1settings.", to_toml(config, comments=False)),
    ]
    with new_file(path, overwrite=True) as unfinished:
        unfinished.write_text("\n".join(lines), encoding="utf-8")
        read_campaign(unfinished)
    return read_campaign(path)
