"""The model as an ordinary differential equation, and its integration."""
