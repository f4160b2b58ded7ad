"""Unknown: dependence that no effect explains, in words, curves and short forms."""
