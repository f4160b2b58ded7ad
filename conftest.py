"""Loads the built packages before any test.

With import-mode=importlib pytest names a test after its path (`hydro_ident.test.test_x`) and makes
the missing parents itself: a package's folder would then stand for the package of the same name.
"""

import hydro_control
import hydro_hw_bridge
import hydro_ident
import hydro_msgs_docs

__all__ = ["hydro_control", "hydro_hw_bridge", "hydro_ident", "hydro_msgs_docs"]
