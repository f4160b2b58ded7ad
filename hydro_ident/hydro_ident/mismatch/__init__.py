"""The diagnosis: what physics a model leaves out. Residuals, locate, name, model, verify."""
