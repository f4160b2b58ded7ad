"""How well a model predicts, and what the sensors alone leave."""
