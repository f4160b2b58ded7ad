"""Online adaptation: what is estimated beside a fixed model while it drives."""
