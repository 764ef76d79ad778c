"""What a process of a run begins with: ``python -m app.processes MODULE``."""

import os
import sys
import traceback
from importlib import import_module

from app.processes.starting import keep_output

if __name__ == "__main__":
    keep_output()
    try:
        import_module(sys.argv[1]).main()
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)  # whatever threads are left: who started it waits for its end
