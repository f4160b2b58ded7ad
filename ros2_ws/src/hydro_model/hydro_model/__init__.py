"""The shared model of a hydraulic manipulator."""

from hydro_model.compile_cache import use_user_cache

use_user_cache()
