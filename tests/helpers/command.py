"""The `deformer` command as a process of its own."""

import sys

# A shell that runs the tests in the background has its programs ignore SIGINT.
_HEED = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
DEFORMER = [sys.executable, "-c", _HEED + "from deformer_app.entry import main; main()"]
