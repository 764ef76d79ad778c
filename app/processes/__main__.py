"""What a process of a run begins with: ``python -m app.processes PART``."""

import sys
from importlib import import_module

if __name__ == "__main__":
    import_module(f"app.processes.{sys.argv[1]}").main()
