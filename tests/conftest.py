"""What holds for every test: no example is judged by its speed, which the machine decides."""

from hypothesis import settings

settings.register_profile("slipscope", deadline=None)
settings.load_profile("slipscope")
