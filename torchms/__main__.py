"""`python -m torchms`."""

import sys

from torchms.cli import main

sys.exit(main())
