"""How the tests of this folder ask for an analysis of sessions."""

from app.study.analysis_plan import RECORDED, plan_analysis

TWO_THREADS = "dic.threads=2"  # which processes beside one another do not use


def asked(sessions, output, *changes):
    return plan_analysis(sessions, output, preset=RECORDED, overrides=(TWO_THREADS, *changes))
