"""``python -m app``: the same as `slipscope`."""

from app.cli import main

main()
