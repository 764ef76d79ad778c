from .commands import (
    UserError as UserError,
    analyze as analyze,
    export as export,
    figures as figures,
    run as run,
)
from .notebook import Session as Session
from .plain_arrays import (
    analysis as analysis,
    dic as dic,
    invert as invert,
    theory as theory,
)
from .results_notebook import Results as Results
