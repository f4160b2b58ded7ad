"""`python -m hydro_ident.bench`."""

import sys

from hydro_ident.bench.command import main

sys.exit(main())
