"""`python -m workbench` is the command `workbench`."""

import sys

from workbench.cli.start import main

sys.exit(main())
