"""What a process of a run begins with: ``python -m app.processes MODULE``."""

import sys
from importlib import import_module

if __name__ == "__main__":
    import_module(sys.argv[1]).main()
