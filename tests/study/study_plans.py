"""How the tests of this folder ask for an analysis of sessions."""

from app.study.analysis_plan import RECORDED, planned

TWO_THREADS = "dic.threads=2"  # which processes beside one another do not use


def asked(sessions, output, *changes):
    return planned(sessions, output, preset=RECORDED, overrides=(TWO_THREADS, *changes))
