"""`python -m massid`: the same as the `massid` command."""

import sys

from massid.cli import main

sys.exit(main())
