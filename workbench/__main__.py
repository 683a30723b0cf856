"""`python -m workbench` is the command `workbench`."""

import sys

from workbench.cli.run import main

sys.exit(main())
