"""Symbols as they are printed, from the plain text of the program: sigma_xz, chi2, um."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

_WORDS = {  # of plain text -> as it is printed
    "alpha": "α", "beta": "β", "chi2": "χ²", "delta": "δ", "lambda": "λ", "mu": "μ", "nu": "ν",
    "sigma": "σ", "tau": "τ", "theta": "θ", "um": "µm", "uJ": "µJ",
}  # fmt: skip
_GREEK = re.compile(rf"(?<![A-Za-z0-9_.])({'|'.join(_WORDS)})(?![A-Za-z0-9.]|_[a-z]{{3}})")
_ROOT = re.compile(r"\bsqrt\(")
_MEAN = re.compile(r"<(μ(?:_\w)?)>")
_INDEX = re.compile(r"(?<![A-Za-z0-9_.])([A-Za-zα-ωΔ])_([A-Za-z]{1,3}|\d)(?![A-Za-z0-9_])")
_MINUS = re.compile(r"(?<![\w-])-(?=\d|\w</sup>)")
_POWER = re.compile(r"\^(?:\(([^()]+)\)|([-−]?\w))")


def in_unicode(text: str) -> str:
    """A text with Greek letters, roots and units of micrometres in place of their names.

    Examples
    --------
    >>> in_unicode("sigma_xz/(mu p), sqrt(R h) in um, chi2")
    'σ_xz/(μ p), √(R h) in µm, χ²'
    """
    plain = _GREEK.sub(lambda found: _WORDS[found[1]], text)
    return _MEAN.sub(r"⟨\1⟩", _ROOT.sub("√(", plain))


def in_html(text: str) -> Markup:
    """The same as HTML, escaped, with indices below and powers above the line, and minus signs.

    Examples
    --------
    >>> print(in_html("mu_s < 1, P^-n, -0.5 on 2026-11-26"))
    μ<sub>s</sub> &lt; 1, P<sup>−n</sup>, −0.5 on 2026-11-26
    """
    safe = str(escape(in_unicode(text)))
    safe = _INDEX.sub(r"\1<sub>\2</sub>", safe)
    safe = _POWER.sub(lambda found: f"<sup>{found[1] or found[2]}</sup>", safe)
    return Markup(_MINUS.sub("−", safe))
