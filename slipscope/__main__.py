"""``python -m slipscope``: the same as `slipscope`."""

from app.cli import main

if __name__ == "__main__":
    main()
